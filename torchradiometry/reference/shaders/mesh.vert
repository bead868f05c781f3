#version 330 core
// Vertices arrive relative to the origin of the pass (double precision was spent on the CPU).
layout(location = 0) in vec3 position;
layout(location = NORMAL_LOC) in vec3 normal;
#ifdef TEXCOORD_0_LOC
layout(location = TEXCOORD_0_LOC) in vec2 texcoord_0;
#endif

uniform mat4 V; // world to camera
uniform mat4 P; // camera to clip space

out vec3 frag_position;
out vec3 frag_normal;
out float frag_depth; // m, along the view axis
out vec2 frag_texcoord;

void main()
{
    vec4 in_camera = V * vec4(position, 1.0);
    gl_Position = P * in_camera;
    frag_position = position;
    frag_normal = normal;
    frag_depth = -in_camera.z;
#ifdef TEXCOORD_0_LOC
    frag_texcoord = texcoord_0;
#else
    frag_texcoord = vec2(0.0);
#endif
}
