//! Displacement fields, compressed: each rounded to a share of its largest component, less the state before, deflated.

use palpate_simulate::State;

/// Steps from 0 to a field's largest component. A component is off by half a step at most: 6e-5 of the largest.
pub const LEVELS: f64 = 8192.0;

/// m for each step of `field`; 0 where nothing moved.
pub fn unit_m(field: &[[f32; 3]]) -> f64 {
    let largest = field.iter().flatten().fold(0.0, |m: f32, c| m.max(c.abs()));
    f64::from(largest) / LEVELS
}

/// The fields of states that follow each other.
pub fn compress(states: &[&State], nodes: usize) -> Vec<u8> {
    let count = 3 * nodes;
    let mut before = vec![0_i16; count];
    let mut bytes = Vec::with_capacity(2 * count * states.len());
    let mut high = Vec::with_capacity(count);
    for state in states {
        let unit = unit_m(&state.displacement_m);
        high.clear();
        for (component, before) in state.displacement_m.iter().flatten().zip(&mut before) {
            let now = if unit > 0.0 { (f64::from(*component) / unit).round() as i16 } else { 0 };
            // Fields in proportion leave small differences, whose sign goes to the lowest bit: bytes of many zeros.
            let difference = now.wrapping_sub(*before);
            let folded = ((difference << 1) ^ (difference >> 15)) as u16;
            *before = now;
            let [l, h] = folded.to_le_bytes();
            bytes.push(l);
            high.push(h);
        }
        bytes.extend_from_slice(&high);
    }
    miniz_oxide::deflate::compress_to_vec_zlib(&bytes, 6)
}

/// The fields of states whose units are `units_m`, or `None` if `bytes` don't hold them.
pub fn expand(bytes: &[u8], units_m: &[f64], nodes: usize) -> Option<Vec<Vec<[f32; 3]>>> {
    let count = nodes.checked_mul(3)?;
    let length = count.checked_mul(2)?.checked_mul(units_m.len())?;
    // Deflate reaches 1 : 1032. What claims more is rejected, and no memory is asked for.
    if length / 1040 > bytes.len() {
        return None;
    }
    let plain = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(bytes, length).ok()?;
    if plain.len() != length {
        return None;
    }
    let mut before = vec![0_i16; count];
    let mut fields = Vec::with_capacity(units_m.len());
    for (planes, unit) in plain.chunks_exact((2 * count).max(1)).zip(units_m) {
        let (low, high) = planes.split_at(count);
        for ((l, h), before) in low.iter().zip(high).zip(&mut before) {
            let folded = u16::from_le_bytes([*l, *h]);
            *before = before.wrapping_add((folded >> 1) as i16 ^ -((folded & 1) as i16));
        }
        let component = |c: i16| (f64::from(c) * unit) as f32;
        fields.push(
            before.chunks_exact(3).map(|c| [component(c[0]), component(c[1]), component(c[2])]).collect(),
        );
    }
    // No nodes, no planes.
    fields.resize(units_m.len(), Vec::new());
    Some(fields)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_come_back_within_the_stated_error() {
        let nodes = 500;
        let field = |scale: f64, wave: f64| {
            let component = |i: usize, c: usize| (scale * (wave * (3 * i + c) as f64).sin()) as f32;
            (0..nodes).map(|i| [component(i, 0), component(i, 1), component(i, 2)]).collect::<Vec<_>>()
        };
        let fields = [field(1e-3, 0.3), field(2e-3, 0.3), vec![[0.0; 3]; nodes], field(8e-3, 0.7)];
        let states: Vec<State> =
            fields.iter().map(|f| State { displacement_m: f.clone(), ..State::default() }).collect();
        let bytes = compress(&states.iter().collect::<Vec<_>>(), nodes);
        let units: Vec<f64> = fields.iter().map(|f| unit_m(f)).collect();
        let back = expand(&bytes, &units, nodes).unwrap();
        for ((field, back), unit) in fields.iter().zip(&back).zip(&units) {
            for (a, b) in field.iter().flatten().zip(back.iter().flatten()) {
                assert!(f64::from((a - b).abs()) <= 0.51 * unit, "{a} {b} {unit}");
            }
        }
        assert!(bytes.len() < 6 * nodes * fields.len(), "{}", bytes.len());
        assert!(expand(&bytes, &units[1..], nodes).is_none());
        assert!(expand(&bytes[..bytes.len() / 2], &units, nodes).is_none());
        assert!(expand(&bytes, &units, usize::MAX / 2).is_none());
        assert_eq!(expand(&compress(&[&State::default()], 0), &[0.0], 0), Some(vec![vec![]]));
    }
}
