//! Colours of values in pictures.

/// Viridis at nine even places (Smith and van der Walt 2015).
const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Viridis: from dark blue over green to yellow, ever lighter, so that it reads in grey and with every common kind of colour blindness.
/// At `share` from 0 to 1; red, green and blue as a screen has them (sRGB), 0 to 1.
pub fn viridis(share: f64) -> [f64; 3] {
    between(&VIRIDIS, share)
}

/// Between even stops, as a screen mixes them.
pub fn between(stops: &[[u8; 3]], share: f64) -> [f64; 3] {
    let x = share.clamp(0.0, 1.0) * stops.len().saturating_sub(1) as f64;
    let at =
        |i: usize, c: usize| stops.get(i).or(stops.last()).map_or(0.0, |stop| f64::from(stop[c]) / 255.0);
    let i = x as usize;
    std::array::from_fn(|c| at(i, c) + (at(i + 1, c) - at(i, c)) * (x - i as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viridis_gets_lighter_all_the_way() {
        // To the eye (Rec. 709).
        let light = |share: f64| {
            let [r, g, b] = viridis(share).map(|c| c.powf(2.2));
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let all: Vec<f64> = (0..=100).map(|i| light(f64::from(i) / 100.0)).collect();
        assert!(all.windows(2).all(|w| w[1] > w[0]), "{all:?}");
        assert_eq!((viridis(-1.0), viridis(7.0)), (viridis(0.0), viridis(1.0)));
        assert_eq!(viridis(1.0), [253, 231, 37].map(|c| f64::from(c) / 255.0));
    }
}
