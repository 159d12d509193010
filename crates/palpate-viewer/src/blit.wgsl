// A finished picture onto the window, pixel by pixel.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var between: sampler;

@fragment
fn as_it_is(in: Whole) -> @location(0) vec4<f32> {
    return vec4<f32>(textureSampleLevel(picture, between, in.place, 0.0).rgb, 1.0);
}

// For a window that turns linear light into a screen's values by itself.
@fragment
fn as_light(in: Whole) -> @location(0) vec4<f32> {
    let c = textureSampleLevel(picture, between, in.place, 0.0).rgb;
    let low = c / 12.92;
    let high = pow((c + vec3<f32>(0.055)) / 1.055, vec3<f32>(2.4));
    return vec4<f32>(select(high, low, c <= vec3<f32>(0.04045)), 1.0);
}
