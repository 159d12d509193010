//! `report.md`: the experiment in plain words.

use super::pictures::{CLOSE_UP, TITLES};
use super::report::{ABLATED_EXCESS_MIN, EXCESS_MAX, REFINEMENT_MAX, Report, Setting};
use super::{ridges, rules};
use std::fmt::Write;

/// The table of the settings, for a terminal and for the report.
pub fn table(report: &Report) -> String {
    let mut text = String::from(
        "| setting              | clicks | largest step | excess step | steps at 10× and 100× | energy created |\n\
         |:---------------------|-------:|-------------:|------------:|----------------------:|---------------:|\n",
    );
    for (s, title) in report.settings.iter().zip(TITLES) {
        let _ = writeln!(
            text,
            "| {title:20} | {:6} | {:9.1} mN | {:8.1} mN | {:10.4}, {:9.4} | {:11.2} mJ |",
            s.clicks,
            s.largest_step_n * 1e3,
            s.excess_step_n * 1e3,
            s.refinement[1],
            s.refinement[2],
            s.generated_j * 1e3,
        );
    }
    text
}

/// The report; `folder` is how the user calls the output folder.
pub fn markdown(report: &Report, folder: &str) -> String {
    let Report { settings, path, body, sound, lipschitz_n_per_m: [_, steepest], .. } = report;
    let (Some(both), Some(coordinates), Some(responses)) =
        (settings.first(), settings.get(1), settings.get(2))
    else {
        return String::new();
    };
    let verdict = if report.passed {
        "**Result: passed.** With both interpolations there is no click; without either one there is."
            .to_owned()
    } else {
        format!("**Result: fell short.**\n\n- {}", report.shortfalls.join("\n- "))
    };
    format!(
        "# Touching a soft cylinder, with and without interpolation

{verdict}

## What was done

A tool tip touches a soft cylinder: it presses {depth:.1} mm in, drags around the body at up to {speed:.0} mm/s, draws a
circle, and lets go. That takes {duration:.1} s, and the force on the tool is computed 1000 times a second, as a haptic device
would ask for it.

The cylinder is the one of Mahvash and Hayward (2003, section 5): {triangles} triangles; at every corner of them (a *node*)
a force-deflection curve is stored, and it differs from node to node: one side of the body is more than four times as
stiff as the other. Friction is {friction}. Between the nodes two things are interpolated:

- **coordinates**: which way is *inward*. Without it, each flat triangle has its own direction;
- **responses**: the stored curves. Without it, each triangle has one stiffness.

The same path is run in four settings: with both, without one, without the other, without both.

## What came out

{table}
- A **step** is how far the force moves from one millisecond to the next. A large one is no fault by itself: pressing
  fast into something stiff is steep. So each is compared with the most that a smooth body could do, its steepest
  slope at that place (here up to {steepest:.0} N/m) times the way of the tool. What is beyond that is the **excess step**;
  an excess of more than 1 mN counts as a **click**.
- **Steps at 10× and 100×**: the same path computed with 10 and 100 times as many samples. If the force is
  continuous, its largest step shrinks to 0.1 and 0.01. A jump stays: 1.
- **Energy created**: what sliding gave to the tool out of nothing. A real body never does.

To pass, the setting with both may have at most {excess:.0} mN of excess, and its steps must shrink to {r10} and {r100} or less;
each of the next two must show an excess of at least {ablated:.0} mN however fine the sampling. With both, no step uses more
than {used:.0} % of what the bound allows. All the work that the tool did there ({work:.1} mJ) went into friction: the books of
energy balance to {ledger:.0e} J in every setting.

## Where energy comes from

The paper's slip rule can create energy: without friction, pressed in where the body is soft, dragged to where it is three
times as stiff, and let go, the hand gets back more than it gave. The rule `consistent`, the default of new bodies, adds
what the energy's own slope does to the contact point and hands out next to nothing, the less the finer the mesh; `exact`
hands out nothing at all, but it clicks. `rules.png` shows the energy as it comes and goes.

{rules}
## Ridges

Interpolation takes the jumps away, not the ridges: depth is measured from a flat facet, and the tube has 24 of them. So the
surface itself can be **refined**: its triangles are divided until they follow the round surface through the nodes, over the
same stored curves (`palpate refine`). A turn around a tube that is alike everywhere, 5 mm deep:

{ridges}
- **Ripple**: the greatest magnitude of the force less the least, in newtons and as a share of the mean.
- **Largest step**: of the force from one sample to the next, with its direction. On flat facets it jumps at each edge.

To pass, the force on the refined surface may ripple by less than {ripple_percent} % and {ripple_mn} mN. `ridges.png` shows a
quarter of the turn.

## What the pictures show

- `force.png`: the force in the four settings, outward (the body pushes back), around and along (friction). Red
  triangles are clicks. In the first panel the line has soft ridges, because a cylinder of flat triangles has 24 of them,
  but no jump. Without coordinates the force around is a saw: at each ridge the direction flips by 15°. Without
  responses the outward force is a stair.
- `clicks.png`: {from:.1} to {to:.1} s of it, sample by sample. The blue dots follow each other closely; the others leap.
- `body.png`: the body from both sides, coloured by stiffness, with the way of the contact point. Every click happens
  where the contact point crosses an edge of the mesh.
- `curves.png`: what is stored at the softest and the stiffest node.

## With the loop closed

In all of this the path is given and only the force is watched. At a device both answer each other: the force moves the hand,
and the hand changes the force. So a simulated tool of 0.1 kg, held by fingers, slides over the cylinder at 30 mm/s, and then
rests at {places} places within half a millimetre of an edge, inside the same tube with a wet wall (friction 0.05).

{loops}
- **Texture**: what of the force lies above 100 Hz, root mean square. The hand intends nothing there.
- **Limit cycles**: rests at which the tool doesn't come to rest but swings on, restlessly, though the hand holds still. Inside,
  an edge is a groove; without coordinates the force flips from side to side in it.

To pass, the setting with both may have {texture} mN of texture and no cycle; the others must have {ablated_texture} mN, and without
coordinates at least one rest must cycle. `loops.png` shows spectra and motions.

## What one hears

`force-rate-both.wav` and its three siblings play how fast the force changes. Smooth touch changes too slowly to be
heard: the first file is as good as silent. In the others each click is a tick: {coordinate_clicks} loud ones without
coordinates, {response_clicks} softer ones without responses. All four have the same gain, so that they can be compared: full scale is
{scale:.0} N/s in the direction halfway between outward and around, averaged over {window:.1} ms. {cut} samples had to be cut.

## Going on

```
palpate inspect {folder}/cylinder.body
palpate trace {folder}/cylinder.body --path {folder}/path.csv -o trace.csv
palpate trace {folder}/cylinder.body --path {folder}/path.csv -o jumps.csv --ablate coordinates
```

`path.csv` is the path (time in s, tip in m): change it, or record your own. `report.json` holds every number.
",
        depth = path.depth_m * 1e3,
        speed = path.fastest_m_per_s * 1e3,
        duration = path.duration_s,
        triangles = body.triangles,
        friction = body.friction,
        table = table(report),
        ridges = ridges::table(&report.ridges),
        ripple_percent = ridges::RIPPLE_MAX.0,
        ripple_mn = ridges::RIPPLE_MAX.1 * 1e3,
        rules = rules::table(&report.slip_rules),
        excess = EXCESS_MAX * 1e3,
        r10 = REFINEMENT_MAX[0],
        r100 = REFINEMENT_MAX[1],
        ablated = ABLATED_EXCESS_MIN * 1e3,
        used = both.bound_used * 100.0,
        work = both.work_j * 1e3,
        ledger = settings.iter().map(|s: &Setting| s.ledger_error_j.abs()).fold(0.0, f64::max),
        from = CLOSE_UP.start,
        to = CLOSE_UP.end,
        coordinate_clicks = coordinates.clicks,
        response_clicks = responses.clicks,
        loops = report.closed_loop.table(),
        places = report.closed_loop.resting.first().map_or(0, |r| r.places),
        texture = super::loops::TEXTURE_MAX * 1e3,
        ablated_texture = super::loops::ABLATED_TEXTURE_MIN * 1e3,
        scale = sound.full_scale_n_per_s,
        window = sound.window_s * 1e3,
        cut = sound.cut_samples,
    )
}
