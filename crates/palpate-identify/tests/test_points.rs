//! Where test points are put.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{BlendWeights, Surface, TriangleMesh};
use palpate_identify::{Amount, spread, test_points, touchable};

fn ball() -> Surface {
    Shape::Sphere { radius_mm: 30.0 }
        .surface(Resolution { edge_length_mm: Some(2.0), ..Default::default() })
        .unwrap()
}

/// An open plane of `n` × `n` squares of 1 mm, bent up by `height` of its x in mm.
fn sheet(n: u32, height: impl Fn(f64) -> f64) -> Surface {
    let at = |i: u32, j: u32| i + (n + 1) * j;
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (f64::from(i), f64::from(j))));
    let positions = positions.map(|(x, y)| DVec3::new(x, y, height(x)) * 1e-3).collect();
    let squares = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    });
    Surface::build(&TriangleMesh { positions, triangles: triangles.collect() }, f64::INFINITY).unwrap()
}

fn all(surface: &Surface) -> Vec<bool> {
    vec![true; surface.positions().len()]
}

/// Each point's distance to the nearest other.
fn gaps(surface: &Surface, points: &[u32]) -> Vec<f64> {
    let p = |n: u32| surface.positions()[n as usize];
    let others = |a: u32| points.iter().filter(move |&&b| b != a).map(move |&b| p(a).distance(p(b)));
    points.iter().map(|&a| others(a).fold(f64::INFINITY, f64::min)).collect()
}

#[test]
fn points_lie_evenly_on_a_ball_and_are_exactly_so_many() {
    let surface = ball();
    for count in [1, 2, 7, 60, 200] {
        let points = test_points(&surface, &all(&surface), Amount::Count(count), None).unwrap();
        assert_eq!(points.len(), count);
        assert!(points.windows(2).all(|p| p[0] < p[1]));
        assert_eq!(points, test_points(&surface, &all(&surface), Amount::Count(count), None).unwrap());
        if count < 7 {
            continue;
        }
        // A triangular lattice of this density has gaps of 1.07 √(area / count).
        let even = (4.0 * std::f64::consts::PI * 0.03 * 0.03 / count as f64).sqrt();
        for gap in gaps(&surface, &points) {
            assert!((0.7 * even..1.5 * even).contains(&gap), "{count}: {gap} {even}");
        }
    }
    let points = test_points(&surface, &all(&surface), Amount::Spacing(0.01), None).unwrap();
    assert!((points.len() as i32 - 131).abs() <= 1, "{}", points.len());
    assert!(test_points(&surface, &all(&surface), Amount::Spacing(1.0), None).unwrap().len() == 1);
}

#[test]
fn what_cannot_be_touched_has_none_and_its_rim_has_some() {
    let surface = ball();
    let touchable: Vec<bool> = surface.positions().iter().map(|p| p.x > -10e-3).collect();
    let points = test_points(&surface, &touchable, Amount::Count(60), None).unwrap();
    assert!(points.iter().all(|&n| touchable[n as usize]));
    let x = |n: u32| surface.positions()[n as usize].x;
    let on_rim = points.iter().filter(|&&n| x(n) < -7e-3).count();
    assert!((8..30).contains(&on_rim), "{on_rim}");
    // Few nodes that can be touched lie outside the points' mesh: most blends have three parts.
    let blends = spread(&surface, &points).unwrap();
    let inside = |m: &BlendWeights| m.weights.iter().filter(|&&w| w > 0.0).count() == 3;
    let open = || blends.iter().zip(&touchable).filter(|(_, t)| **t);
    let share = open().filter(|(m, _)| inside(m)).count() as f64 / open().count() as f64;
    assert!(share > 0.85, "{share}");
}

#[test]
fn points_are_denser_where_the_surface_turns_and_the_guide_changes() {
    let surface = sheet(60, |x| if x < 30.0 { 0.0 } else { 4.0 * ((x - 30.0) / 3.0).sin() });
    let points = test_points(&surface, &all(&surface), Amount::Count(60), None).unwrap();
    let right = points.iter().filter(|&&n| surface.positions()[n as usize].x > 30e-3).count();
    assert!(right > 36, "{right} of 60 where it turns");

    let flat = sheet(60, |_| 0.0);
    let compliance_prior: Vec<f64> = flat
        .positions()
        .iter()
        .map(|p| if p.x < 30e-3 { 100.0 } else { 100.0 + 3e4 * (p.x - 30e-3) })
        .collect();
    let points = test_points(&flat, &all(&flat), Amount::Count(60), Some(&compliance_prior)).unwrap();
    let right = points.iter().filter(|&&n| flat.positions()[n as usize].x > 30e-3).count();
    assert!(right > 33, "{right} of 60 where the compliance prior changes");
}

#[test]
fn a_margin_is_left_along_the_surface() {
    let surface = sheet(40, |_| 0.0);
    let held: Vec<bool> = surface.positions().iter().map(|p| p.x < 10.5e-3).collect();
    let open = touchable(&surface, &held, 5e-3 + 1e-9).unwrap();
    for (p, open) in surface.positions().iter().zip(open) {
        assert_eq!(open, p.x > 15.5e-3, "{p}");
    }
    // A thin sheet, held from behind.
    let block = Shape::Block { size_mm: [40.0, 40.0, 2.0] };
    let surface = block.surface(Resolution { edge_length_mm: Some(2.0), ..Default::default() }).unwrap();
    let held: Vec<bool> = surface.positions().iter().map(|p| p.z < 0.0).collect();
    let open = touchable(&surface, &held, 5e-3).unwrap();
    for (p, open) in surface.positions().iter().zip(open) {
        let inner = p.z > 0.9e-3 && p.x.abs().max(p.y.abs()) < 16.5e-3;
        assert!(!inner || open, "{p}");
        assert!(p.z > 0.9e-3 || !open, "{p}");
    }
    assert_eq!(touchable(&surface, &vec![false; held.len()], 1.0).unwrap(), vec![true; held.len()]);
    assert!(touchable(&surface, &held[1..], 1.0).is_err());
}

#[test]
fn messages_name_the_place_and_the_hint() {
    let surface = sheet(3, |_| 0.0);
    let touchable = all(&surface);
    for (mask, amount, compliance_prior, says) in [
        (touchable[1..].to_vec(), Amount::Count(3), None, "15 entries for 16 nodes"),
        (vec![false; 16], Amount::Count(3), None, "free of supports"),
        (touchable.clone(), Amount::Count(17), None, "17 are asked for"),
        (touchable.clone(), Amount::Count(0), None, "0 are asked for"),
        (touchable.clone(), Amount::Spacing(0.0), None, "the spacing is 0 m"),
        (touchable.clone(), Amount::Spacing(f64::NAN), None, "greater than 0"),
        (touchable.clone(), Amount::Count(3), Some(vec![1.0; 3]), "3 values for 16 nodes"),
        (touchable, Amount::Count(3), Some(vec![0.0; 16]), "positive numbers"),
    ] {
        let message =
            test_points(&surface, &mask, amount, compliance_prior.as_deref()).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
    }
}
