#version 330 core
in float frag_depth;

uniform float light_far; // m

void main()
{
    gl_FragDepth = frag_depth / light_far;
}
