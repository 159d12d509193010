//! How well the loop kept its time, and what it did: from the records, outside of the haptic thread.

use crate::{Record, StageCounts, StageFlags};
use hdrhistogram::Histogram;
use palpate_engine::Flags;
use serde::Serialize;
use std::collections::BTreeMap;

/// Times are distinguished up to here, ns; what is longer counts as this long but for the maximum.
const LONGEST: u64 = 60_000_000_000;
/// Digits that are distinguished.
const DIGITS: u8 = 3;

/// Sums and histograms of a fixed size.
#[derive(Debug, Clone)]
pub struct Statistics {
    period_ns: u64,
    times: [Times; 5],
    overruns: u64,
    touching: u64,
    /// The largest force and torque that were commanded, squared.
    largest: [f64; 2],
    stages: StageCounts,
    periods: u64,
    last: Option<Record>,
}

/// A histogram, and its exact maximum.
#[derive(Debug, Clone)]
struct Times {
    histogram: Histogram<u64>,
    most: u64,
}

/// How long something took: what half, 99 and 99.9 % of the periods stayed below (to three digits), and the longest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[expect(missing_docs, reason = "the names say it")]
pub struct Percentiles {
    pub p50: u64,
    pub p99: u64,
    pub p99_9: u64,
    pub max: u64,
}

/// Statistics of a loop up to a moment.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Summary {
    /// The loop's time in the last period, s.
    pub time_s: f64,
    /// Periods that were counted.
    pub periods: u64,
    /// From one period's beginning to the next.
    pub period_ns: Percentiles,
    /// From a period's due time to its beginning; early counts as 0.
    pub lateness_ns: Percentiles,
    /// What the engine and the stages took.
    pub step_ns: Percentiles,
    /// What the device's read took.
    pub read_ns: Percentiles,
    /// What the device's write took.
    pub write_ns: Percentiles,
    /// Periods that began later than a whole period after their time.
    pub overruns: u64,
    /// Page faults of the haptic thread without the disk.
    pub minor_page_faults: u32,
    /// Page faults of the haptic thread with the disk.
    pub major_page_faults: u32,
    /// Periods in which the loop waited for a patch.
    pub patch_waits: u64,
    /// Records that found the ring full: they are in none of the other figures.
    pub dropped_records: u64,
    /// Periods in contact.
    pub periods_in_contact: u64,
    /// Periods in which each stage did something, those that ever did.
    pub stages: BTreeMap<&'static str, u64>,
    /// Work of the tool on the body, J.
    pub work_j: f64,
    /// Energy stored in the last period, J.
    pub stored_j: f64,
    /// Energy dissipated, J.
    pub dissipated_j: f64,
    /// The part of it that slip generated, J.
    pub generated_j: f64,
    /// Given out at the engine's port, J.
    pub out_j: f64,
    /// The largest force that was commanded, N.
    pub force_max_n: f64,
    /// The largest torque, N·m.
    pub torque_max_nm: f64,
}

impl Times {
    fn new() -> Self {
        // The bounds are constants that are in order.
        let histogram = Histogram::new_with_bounds(1, LONGEST, DIGITS)
            .unwrap_or_else(|_| unreachable!("the bounds are constants in order"));
        Times { histogram, most: 0 }
    }

    fn add(&mut self, ns: u64) {
        self.histogram.saturating_record(ns);
        self.most = self.most.max(ns);
    }

    fn percentiles(&self) -> Percentiles {
        // A bin's upper edge may lie above all that is in it.
        let at = |quantile: f64| self.histogram.value_at_quantile(quantile).min(self.most);
        Percentiles { p50: at(0.5), p99: at(0.99), p99_9: at(0.999), max: self.most }
    }
}

impl Statistics {
    /// Of a loop of this rate.
    pub fn new(rate_hz: f64) -> Self {
        Statistics {
            period_ns: (1e9 / rate_hz) as u64,
            times: std::array::from_fn(|_| Times::new()),
            overruns: 0,
            touching: 0,
            largest: [0.0; 2],
            stages: StageCounts::default(),
            periods: 0,
            last: None,
        }
    }

    /// Counts a period.
    pub fn add(&mut self, record: &Record) {
        let late = record.lateness_ns.max(0) as u64;
        let [period, lateness, step, read, write] = &mut self.times;
        // The first period has none before it.
        if record.period_ns > 0 {
            period.add(record.period_ns);
        }
        lateness.add(late);
        step.add(record.step_ns.into());
        read.add(record.read_ns.into());
        write.add(record.write_ns.into());
        self.overruns += u64::from(late > self.period_ns);
        for (largest, v) in self.largest.iter_mut().zip([record.command_force_n, record.command_torque_nm]) {
            *largest = largest.max(v.iter().map(|x| x * x).sum());
        }
        self.touching += u64::from(record.engine().has(Flags::IN_CONTACT));
        self.stages.add(record.stages());
        self.periods += 1;
        self.last = Some(*record);
    }

    /// What they come to.
    pub fn summary(&self) -> Summary {
        let [period_ns, lateness_ns, step_ns, read_ns, write_ns] =
            std::array::from_fn(|i| self.times[i].percentiles());
        let times = Summary { period_ns, lateness_ns, step_ns, read_ns, write_ns, ..Summary::default() };
        let Some(last) = &self.last else { return times };
        let counted = StageFlags::NAMED.map(|(name, flag)| (name, self.stages.of(flag)));
        Summary {
            time_s: last.time_s,
            periods: self.periods,
            overruns: self.overruns,
            minor_page_faults: last.minor_faults,
            major_page_faults: last.major_faults,
            patch_waits: last.patch_waits,
            periods_in_contact: self.touching,
            stages: counted.into_iter().filter(|(_, count)| *count > 0).collect(),
            work_j: last.work_j,
            stored_j: last.stored_j,
            dissipated_j: last.dissipated_j,
            generated_j: last.generated_j,
            out_j: last.out_j,
            force_max_n: self.largest[0].sqrt(),
            torque_max_nm: self.largest[1].sqrt(),
            ..times
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn record(k: u64) -> Record {
        Record {
            number: k,
            time_s: k as f64 * 1e-3,
            period_ns: if k == 0 { 0 } else { 1_000_000 },
            lateness_ns: if k % 100 == 99 { 1_000_001 } else { -5 },
            step_ns: k as u32 + 1,
            engine_flags: (k % 2) as u32,
            stage_flags: StageFlags::STEPPED.bits(),
            work_j: k as f64,
            command_force_n: [0.0, 3.0 * (k % 7) as f64, 4.0 * (k % 7) as f64],
            command_torque_nm: [0.0, 0.0, -0.01 * (k % 5) as f64],
            minor_faults: 3,
            ..Record::zeroed()
        }
    }

    #[test]
    fn percentiles_counts_and_sums() {
        let mut statistics = Statistics::new(1000.0);
        assert_eq!(statistics.summary(), Summary::default());
        (0..1000).for_each(|k| statistics.add(&record(k)));
        let summary = statistics.summary();
        assert_eq!(summary.step_ns, Percentiles { p50: 500, p99: 990, p99_9: 999, max: 1000 });
        assert_eq!(summary.period_ns.p50, 1_000_000);
        assert_eq!(summary.lateness_ns, Percentiles { p50: 0, p99: 0, p99_9: 1_000_001, max: 1_000_001 });
        assert_eq!((summary.periods, summary.overruns, summary.periods_in_contact), (1000, 10, 500));
        assert_eq!((summary.force_max_n, summary.torque_max_nm), (30.0, 0.04));
        assert_eq!((summary.work_j, summary.minor_page_faults), (999.0, 3));
        assert_eq!(summary.stages, BTreeMap::from([("stepped", 1000)]));
    }
}
