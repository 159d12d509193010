//! The sampled-data rule (MODEL 5): a loop cycles where K_max exceeds what damping and period allow, and not below; and
//! what the two output stages that cure it cost.

mod common;

use common::{Pressed, bench, plane, press};
use palpate_device::presets;
use palpate_runtime::{Coupling, PassivityController, Stages};

/// MODEL 5's figure: 0.1 kg with 0.3 N·s/m on f = 100 · 600 δ² at 1 kHz is quiet at 490 N/m and cycles at 693: the
/// border is 2b/T = 600 N/m.
#[test]
fn quiet_at_490_and_cycling_at_693() {
    let (body, device) = (plane(600.0, 500.0, 0.3), presets::device("bench").unwrap());
    let [quiet, cycling] = [1.0, 2.0].map(|push| press(&body, &device, Stages::default(), push, 60.0));
    println!("{quiet:?}\n{cycling:?}");
    assert!((quiet.stiffness - 489.9).abs() < 0.5 && (cycling.stiffness - 692.8).abs() < 0.5);
    assert!(quiet.cycle.is_none());
    assert!(cycling.cycle.expect("a cycle").amplitude_m > 1e-3);
}

/// On either side of the border, by 8 %, for dampings, delays and frictions two decades apart in all.
#[test]
fn the_border_is_where_the_rule_says() {
    let (period, error) = (1e-3, 25e-6);
    // The device, and the stiffness that it allows, N/m.
    let cases = [
        (bench(0.1, 0.0, 0.0, 0.0), 0.1 / (0.5 * period)),
        (bench(1.0, 0.0, 0.0, 0.0), 1.0 / (0.5 * period)),
        (bench(0.45, period, 0.0, 0.0), 0.45 / (1.5 * period)),
        (bench(1.5, period, 0.0, 0.0), 1.5 / (1.5 * period)),
        (bench(2.5, 0.0, 0.02, 2.0 * error), 0.02 / error),
    ];
    for (device, border) in cases {
        let at = |stiffness: f64| {
            // Between two steps of an encoder: the worst case, which the rule is for.
            let depth = 4e-3 + 0.5 * device.mechanics.resolution_m.value;
            let k = stiffness / (200.0 * depth);
            press(&plane(k, k, 0.3), &device, Stages::default(), 0.5 * stiffness * depth, 40.0)
        };
        let (below, above) = (at(0.92 * border), at(1.08 * border));
        assert!(below.cycle.is_none(), "{border} N/m, below: {below:?}");
        assert!(above.cycle.is_some(), "{border} N/m, above: {above:?}");
    }
}

/// An encoder without any friction cycles at any stiffness; enough friction stops it.
#[test]
fn an_encoder_needs_friction() {
    let error = 25e-6;
    let body = plane(600.0, 500.0, 0.3);
    let push =
        |coulomb: f64| press(&body, &bench(1.5, 0.0, coulomb, 2.0 * error), Stages::default(), 1.0, 20.0);
    let (free, held) = (push(0.0), push(490.0 * error));
    println!("{free:?}\n{held:?}");
    assert!(free.cycle.is_some() && held.cycle.is_none());
}

/// The controller stops the cycle at 693 N/m, and does nothing where nothing is given out.
#[test]
fn the_passivity_controller_and_its_cost() {
    let (body, device) = (plane(600.0, 500.0, 0.3), presets::device("bench").unwrap());
    let stages = Stages { passivity: Some(PassivityController::new(1e-3, 0.1)), ..Stages::default() };
    let [quiet, cycling] = [1.0, 2.0].map(|push| press(&body, &device, stages, push, 60.0));
    println!("{quiet:?}\n{cycling:?}");
    let active = |p: &Pressed| p.stages.passivity.unwrap().active();
    assert!(active(&quiet) == 0 && quiet.added_n == 0.0);
    assert!(active(&cycling) > 0 && cycling.cycle.is_none());
    // What it adds, in the mean of the squares, is below half a per cent of the force.
    assert!(cycling.added_n < 0.01);
}

/// A coupling of 1,000 N/m makes 693 N/m into 409, which is quiet; the body feels softer for it.
#[test]
fn the_coupling_and_its_cost() {
    let (body, device) = (plane(600.0, 500.0, 0.3), presets::device("bench").unwrap());
    let stages = Stages { coupling: Some(Coupling::new(1000.0, 1200.0)), ..Stages::default() };
    let pressed = press(&body, &device, stages, 2.0, 60.0);
    println!("{pressed:?}");
    assert!(pressed.cycle.is_none());
    // At the device's place the body would answer a (δ + F/k_c)²: δ = 5.77 mm, F/k_c = 2 mm.
    let soft = f64::powi(1.0 + 2e-3 / 5.7735e-3, 2);
    assert!((pressed.asked_n / pressed.rendered_n - soft).abs() < 1e-3);
}
