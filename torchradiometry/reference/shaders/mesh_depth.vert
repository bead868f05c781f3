#version 330 core
// Shadow map: distance along the axis of the light's camera, linear, as a share of light_far.
layout(location = 0) in vec3 position;

uniform mat4 V;
uniform mat4 P;

out float frag_depth;

void main()
{
    vec4 in_light = V * vec4(position, 1.0);
    gl_Position = P * in_light;
    frag_depth = -in_light.z;
}
