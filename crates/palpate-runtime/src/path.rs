//! The path of a tool: rows of a Path CSV, and their resampling to a fixed rate.

use anyhow::{Result, bail};
use glam::{DQuat, DVec3};
use palpate_engine::{ToolState, Waypoint};
use palpate_files::{Table, read_text};
use std::path::Path;

/// Steps that a resampled path may have.
const MAX_STEPS: f64 = 1e8;

/// Reads a Path CSV: `time_s,x_m,y_m,z_m`, and all or none of `qw,qx,qy,qz`.
///
/// # Errors
/// As [`Table::parse`]; a time that does not come after the one before; a quaternion whose length is off by more than
/// 10⁻³; coordinates that the engine would refuse.
pub fn read(path: &Path) -> Result<Vec<Waypoint>> {
    parse(path, &read_text(path)?)
}

fn parse(path: &Path, text: &str) -> Result<Vec<Waypoint>> {
    let table = Table::parse(path, text, &["time_s", "x_m", "y_m", "z_m"], &["qw", "qx", "qy", "qz"])?;
    let mut waypoints: Vec<Waypoint> = Vec::with_capacity(table.rows.len());
    for row in &table.rows {
        let v = &row.values;
        let (time_s, position_m) = (v[0], [v[1], v[2], v[3]]);
        if let Some(before) = waypoints.last().map(|w| w.time_s)
            && time_s <= before
        {
            return Err(table.error(
                row,
                &format!("time_s {time_s} does not come after {before}; sort the rows by time"),
            ));
        }
        if position_m.iter().any(|x| x.abs() > 1e3) {
            return Err(table.error(row, "a coordinate is beyond 1000 m; give positions in m"));
        }
        let mut pose = ToolState::at(position_m);
        if table.optional {
            let q = [v[4], v[5], v[6], v[7]];
            let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
            if (length - 1.0).abs() > 1e-3 {
                let problem = format!("the quaternion's length is {length}; normalise qw, qx, qy, qz");
                return Err(table.error(row, &problem));
            }
            pose.orientation = q.map(|c| c / length);
        }
        waypoints.push(Waypoint { time_s, pose });
    }
    Ok(waypoints)
}

/// The path at `rate_hz`, from its first time on: positions along straight lines, orientations along great arcs. Its
/// last row is the path's, also where that is no whole number of periods after the first.
///
/// # Errors
/// A rate that is not finite or not positive, or asks for more than 10⁸ steps.
pub fn resample(waypoints: &[Waypoint], rate_hz: f64) -> Result<Vec<Waypoint>> {
    let (Some(first), Some(last)) = (waypoints.first(), waypoints.last()) else { return Ok(Vec::new()) };
    if !(rate_hz > 0.0 && rate_hz.is_finite()) {
        bail!("--rate-hz {rate_hz}: give a rate above 0 Hz, such as 1000");
    }
    let periods = (last.time_s - first.time_s) * rate_hz;
    let steps = (periods + 1e-6).floor() + 1.0;
    if steps > MAX_STEPS {
        bail!(
            "--rate-hz {rate_hz}: it gives {steps:.3e} steps; choose a rate that gives at most {MAX_STEPS}"
        );
    }
    let mut segment = 0;
    let at = |k: u64| {
        let time_s = (first.time_s + k as f64 / rate_hz).min(last.time_s);
        while waypoints.get(segment + 2).is_some() && waypoints[segment + 1].time_s <= time_s {
            segment += 1;
        }
        let from = waypoints[segment];
        let Some(to) = waypoints.get(segment + 1) else { return from };
        let s = ((time_s - from.time_s) / (to.time_s - from.time_s)).clamp(0.0, 1.0);
        Waypoint { time_s, pose: between(&from.pose, &to.pose, s) }
    };
    let mut resampled: Vec<Waypoint> = (0..steps as u64).map(at).collect();
    if periods + 1.0 - steps > 1e-6 {
        resampled.push(*last);
    }
    Ok(resampled)
}

fn between(a: &ToolState, b: &ToolState, s: f64) -> ToolState {
    let quaternion = |[w, x, y, z]: [f64; 4]| DQuat::from_xyzw(x, y, z, w);
    let q = quaternion(a.orientation).slerp(quaternion(b.orientation), s);
    let p = DVec3::from_array(a.position_m) * (1.0 - s) + DVec3::from_array(b.position_m) * s;
    ToolState { position_m: p.to_array(), orientation: [q.w, q.x, q.y, q.z] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Waypoint>> {
        parse(Path::new("p.csv"), text)
    }

    #[test]
    fn a_path_is_resampled_between_its_rows() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let path =
            read(&format!("time_s,z_m,y_m,x_m,qw,qx,qy,qz\n1,0,0,0,1,0,0,0\n2,0,0,4,{half},0,0,{half}\n"))
                .unwrap();
        let fine = resample(&path, 4.0).unwrap();
        assert_eq!(fine.len(), 5);
        let xs: Vec<f64> = fine.iter().map(|w| w.pose.position_m[0]).collect();
        assert_eq!(xs, [0.0, 1.0, 2.0, 3.0, 4.0]);
        // Half of a quarter turn about z.
        assert!((fine[2].pose.orientation[3] - (std::f64::consts::PI / 8.0).sin()).abs() < 1e-12);
        assert!(
            resample(&path, 0.0).is_err()
                && resample(&path, f64::NAN).is_err()
                && resample(&path, 1e12).is_err()
        );
    }

    #[test]
    fn the_rows_themselves_survive_their_own_rate() {
        let rows: String = (0..200).map(|i| format!("{},{},0,0\n", f64::from(i) / 1000.0, i)).collect();
        let path = read(&format!("time_s,x_m,y_m,z_m\n{rows}")).unwrap();
        let again = resample(&path, 1000.0).unwrap();
        assert_eq!(again.len(), path.len());
        assert!(
            path.iter().zip(&again).all(|(a, b)| (a.pose.position_m[0] - b.pose.position_m[0]).abs() < 1e-9)
        );
    }

    #[test]
    fn complaints_name_the_line() {
        let message = |rows: &str| read(&format!("time_s,x_m,y_m,z_m\n{rows}")).unwrap_err().to_string();
        assert!(message("1,0,0,0\n1,0,0,0").starts_with("p.csv:3: time_s 1 does not come after 1"));
        assert!(message("1,0,0,3100").contains("beyond"));
        let turned = read("time_s,x_m,y_m,z_m,qw,qx,qy,qz\n0,0,0,0,1,0,0,0.1\n").unwrap_err().to_string();
        assert!(turned.contains("normalise"));
    }
}
