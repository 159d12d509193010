// All of the picture, as one triangle that is larger.

struct Whole {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec2<f32>,
};

@vertex
fn whole(@builtin(vertex_index) i: u32) -> Whole {
    var out: Whole;
    let place = vec2<f32>(f32((i << 1u) & 2u), f32(i & 2u));
    out.clip = vec4<f32>(place * 2.0 - 1.0, 0.0, 1.0);
    out.place = vec2<f32>(place.x, 1.0 - place.y);
    return out;
}
