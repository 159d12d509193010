// The scene: lit surfaces, cut by a plane. Colours are as a screen has them; light is summed in linear parts.

struct Scene {
    clip_from_body: mat4x4<f32>,
    // Keeps what has dot(n, p) <= d; all zero for no plane.
    section: vec4<f32>,
    // From the origin to the camera, m.
    eye: vec4<f32>,
    // Unit vectors towards the lights, in the body's frame.
    key_light: vec4<f32>,
    fill_light: vec4<f32>,
    // Colour of the body's inside.
    inside: vec4<f32>,
    ground_above: vec4<f32>,
    ground_below: vec4<f32>,
    edges: vec4<f32>,
};

@group(0) @binding(0) var<uniform> scene: Scene;

struct Corner {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec4<f32>,
};

struct Surface {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec4<f32>,
};

@vertex
fn corner(in: Corner) -> Surface {
    var out: Surface;
    out.clip = scene.clip_from_body * vec4<f32>(in.position, 1.0);
    out.place = in.position;
    out.normal = in.normal;
    out.colour = in.colour;
    return out;
}

fn linear(c: vec3<f32>) -> vec3<f32> {
    return pow(c, vec3<f32>(2.2));
}

fn screen(c: vec3<f32>) -> vec3<f32> {
    return pow(clamp(c, vec3<f32>(0.0), vec3<f32>(1.0)), vec3<f32>(1.0 / 2.2));
}

fn lit(place: vec3<f32>, normal: vec3<f32>, colour: vec3<f32>, gloss: f32) -> vec3<f32> {
    let n = normalize(normal);
    let towards = normalize(scene.eye.xyz - place);
    let key = max(dot(n, scene.key_light.xyz), 0.0);
    let fill = max(dot(n, scene.fill_light.xyz), 0.0);
    let sky = 0.5 + 0.5 * n.z;
    let halfway = normalize(scene.key_light.xyz + towards);
    let shine = gloss * pow(max(dot(n, halfway), 0.0), 40.0);
    let base = linear(colour);
    let light = 0.72 * key + 0.20 * fill + 0.16 + 0.14 * sky;
    return screen(base * light + vec3<f32>(shine));
}

fn is_cut(place: vec3<f32>) -> bool {
    return dot(scene.section.xyz, place) > scene.section.w && dot(scene.section.xyz, scene.section.xyz) > 0.5;
}

@fragment
fn body(in: Surface, @builtin(front_facing) is_front: bool) -> @location(0) vec4<f32> {
    if is_cut(in.place) {
        discard;
    }
    if is_front {
        return vec4<f32>(lit(in.place, in.normal, in.colour.rgb, 0.10), 1.0);
    }
    return vec4<f32>(lit(in.place, -in.normal, scene.inside.rgb, 0.0), 1.0);
}

@fragment
fn edge(in: Surface) -> @location(0) vec4<f32> {
    if is_cut(in.place) {
        discard;
    }
    return vec4<f32>(scene.edges.rgb, 0.55);
}

@fragment
fn solid(in: Surface) -> @location(0) vec4<f32> {
    return vec4<f32>(lit(in.place, in.normal, in.colour.rgb, 0.25), 1.0);
}

// What something hides shines through.
@fragment
fn hidden(in: Surface) -> @location(0) vec4<f32> {
    return vec4<f32>(lit(in.place, in.normal, in.colour.rgb, 0.0), 0.5);
}

@fragment
fn ground(in: Whole) -> @location(0) vec4<f32> {
    return vec4<f32>(mix(scene.ground_above.rgb, scene.ground_below.rgb, in.place.y), 1.0);
}
