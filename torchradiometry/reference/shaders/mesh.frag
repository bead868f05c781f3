#version 330 core
// Linear radiance of one batch of lights, L = sum over lights of f_r * E * max(0, n . wi),
// in W/m2/sr, with nothing clamped, encoded or tone-mapped. Directions point away from the
// surface. Written for this package and independent of its PyTorch code.

const float PI = 3.14159265358979323846;

const int DISTANT = 0; // power: irradiance on a facing plane, W/m2
const int POINT = 1;   // power: radiant intensity, W/sr
const int SPOT = 2;    // power: radiant intensity on the axis, W/sr
const int EMITTER = 3; // power: radiance times area, W/sr; a small flat cosine emitter

const int NO_LOBE = 0;
const int PHONG = 1;            // ks cos^n(r, v)
const int PHONG_NORMALISED = 2; // ks (n + 2) / 2 pi cos^n(r, v)
const int PHONG_ORIGINAL = 3;   // ks cos^n(r, v) / (n . wi)
const int BLINN = 4;            // ks (n + 2) (n + 4) / 8 pi (2^(-n/2) + n) cos^n(h, n)

#define MAX_LIGHTS 32 // LIGHTS_PER_PASS in rasterizer.py

struct Light {
    int kind;
    vec3 power;
    vec3 position;  // m, relative to the origin of the pass
    vec3 direction; // distant: to the source; spot and emitter: the way it shines
    vec2 cone;      // spot: 1 - cos of the inner and of the outer half angle
    int two_sided;  // emitter: shines from its back as well
};

uniform Light lights[MAX_LIGHTS];
uniform int light_count;

uniform int orthographic;
uniform vec3 eye;      // m, relative to the origin of the pass
uniform vec3 backward; // the camera's +z axis, to the eye of an orthographic camera
uniform float far;     // m

uniform int instance;
uniform int two_sided;
uniform vec3 albedo;
uniform int has_texture;
uniform sampler2D albedo_texture;
uniform vec3 emission;
uniform int lobe;
uniform vec3 specular;
uniform float shininess;

uniform int shadowed;       // the batch is one light with a shadow map
uniform sampler2D shadow_map;
uniform mat4 light_view;
uniform mat4 light_matrix;
uniform float light_far;    // m
uniform float texel;        // m (distant), or m per m of depth (near): width of a map texel
uniform vec3 face;          // near: axis of the cube face the map covers; zero: all directions

in vec3 frag_position;
in vec3 frag_normal;
in float frag_depth;
in vec2 frag_texcoord;

layout(location = 0) out vec4 radiance_out;
layout(location = 1) out vec4 normal_out;
layout(location = 2) out vec4 position_out;
layout(location = 3) out vec4 albedo_out; // a: instance + 1, 0 is the background

// max(0, a . b)^n of unit vectors. 1 - a . b = |a - b|^2 / 2 = v keeps the digits of sharp
// lobes, and log(1 - v) = -2 atanh(v / (2 - v)) those that a software log() would lose.
float cosine_power(vec3 a, vec3 b, float n)
{
    float v = 0.5 * dot(a - b, a - b);
    if (n <= 0.0) {
        return 1.0;
    }
    if (v >= 1.0) {
        return 0.0;
    }
    float z = v / (2.0 - v);
    float zz = z * z;
    float series = z * (1.0 + zz * (1.0 / 3.0 + zz * (0.2 + zz * (1.0 / 7.0 + zz * (1.0 / 9.0
                 + zz * (1.0 / 11.0 + zz / 13.0))))));
    return exp(n * (v < 0.5 ? -2.0 * series : log(1.0 - v)));
}

// The specular lobe, 1/sr. wi, wo and n are unit.
vec3 specular_brdf(vec3 wi, vec3 wo, vec3 n)
{
    if (lobe == NO_LOBE) {
        return vec3(0.0);
    }
    if (lobe == BLINN) {
        float scale = (shininess + 2.0) * (shininess + 4.0) / (8.0 * PI * (exp2(-0.5 * shininess) + shininess));
        return specular * scale * cosine_power(normalize(wi + wo), n, shininess);
    }
    float value = cosine_power(2.0 * dot(n, wi) * n - wi, wo, shininess);
    float scale = lobe == PHONG_NORMALISED ? (shininess + 2.0) / (2.0 * PI) : 1.0;
    return specular * scale * value / (lobe == PHONG_ORIGINAL ? dot(n, wi) : 1.0);
}

// The share of its intensity that a near light sends towards `away` (unit, from the light).
float emission_profile(Light light, vec3 away)
{
    if (light.kind == SPOT) { // 1 - cos a = |u - v|^2 / 2 keeps the digits of narrow cones
        vec3 apart = light.direction - away;
        float versine = 0.5 * dot(apart, apart);
        float width = light.cone.y - light.cone.x;
        float ramp = clamp((light.cone.y - versine) / (width > 0.0 ? width : 1.0), 0.0, 1.0);
        return width > 0.0 ? ramp * ramp : (versine <= light.cone.y ? 1.0 : 0.0);
    }
    if (light.kind == EMITTER) {
        float cosine = dot(light.direction, away);
        return light.two_sided != 0 ? abs(cosine) : max(cosine, 0.0);
    }
    return 1.0;
}

// 1 where the shadow map sees this fragment, 0 behind a nearer surface or beside the map. ng is
// the normal of the face, of either side.
float seen_by_light(vec3 from_light, vec3 wi, vec3 ng)
{
    vec3 size = abs(from_light);
    if (dot(face, face) > 0.0) { // only the fragments of this face of the cube
        float along = dot(from_light, face);
        bool mine = face.x != 0.0 ? (size.x >= size.y && size.x >= size.z)
                  : face.y != 0.0 ? (size.y > size.x && size.y >= size.z)
                                  : (size.z > size.x && size.z > size.y);
        if (!mine || along <= 0.0) {
            return 0.0;
        }
    }
    vec4 clip = light_matrix * vec4(frag_position, 1.0);
    vec2 uv = clip.xy / clip.w * 0.5 + 0.5;
    if (clip.w <= 0.0 || any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) {
        return 0.0;
    }
    float depth = -(light_view * vec4(frag_position, 1.0)).z;
    // A surface seen at angle theta climbs texel * tan(theta) across one texel of the map.
    float cosine = max(abs(dot(ng, wi)), 0.02);
    float width = lights[0].kind == DISTANT ? texel : texel * depth;
    float bias = width * (1.0 + sqrt(1.0 - min(1.0, cosine * cosine)) / cosine) + 4e-7 * light_far;
    return textureLod(shadow_map, uv, 0.0).r * light_far < depth - bias ? 0.0 : 1.0;
}

vec3 reflected(Light light, vec3 wo, vec3 n, vec3 ng, vec3 rho)
{
    vec3 wi = light.direction;
    vec3 facing = light.power;
    vec3 from_light = vec3(0.0);
    if (light.kind != DISTANT) {
        from_light = frag_position - light.position;
        float squared = dot(from_light, from_light);
        // On the lamp, and for an emitter in its own plane to rounding, no light has a value.
        float height = abs(dot(from_light, light.direction));
        if (squared <= 0.0 || (light.kind == EMITTER && height < 4e-7 * far)) {
            return vec3(0.0);
        }
        wi = -from_light * inversesqrt(squared);
        facing *= emission_profile(light, -wi) / squared;
    }
    float cosine = dot(n, wi);
    float visible = shadowed != 0 ? seen_by_light(from_light, wi, ng) : 1.0;
    if (cosine <= 0.0 || dot(n, wo) <= 0.0) {
        return vec3(0.0);
    }
    return (rho / PI + specular_brdf(wi, wo, n)) * facing * cosine * visible;
}

void main()
{
    bool front = gl_FrontFacing;
    float size = length(frag_normal); // 0 where the normals of a fold cancel: black
    vec3 n = frag_normal * (size > 0.0 ? 1.0 / size : 0.0) * (front || two_sided == 0 ? 1.0 : -1.0);
    vec3 across = cross(dFdx(frag_position), dFdy(frag_position));
    vec3 ng = dot(across, across) > 0.0 ? normalize(across) : n;
    vec3 wo = orthographic != 0 ? backward : normalize(eye - frag_position);
    vec3 rho = has_texture != 0 ? texture(albedo_texture, frag_texcoord).rgb : albedo;
    vec3 radiance = emission;
    for (int i = 0; i < light_count; i++) {
        radiance += reflected(lights[i], wo, n, ng, rho);
    }
    if (!front && two_sided == 0) {
        radiance = vec3(0.0); // a black back that still blocks the view and the light
    }
    radiance_out = vec4(radiance, 1.0);
    normal_out = vec4(n, 0.0);
    position_out = vec4(frag_position, frag_depth);
    albedo_out = vec4(rho, float(instance + 1));
    gl_FragDepth = frag_depth / far;
}
