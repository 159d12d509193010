//! Turns `palpate bench --json` on standard input into a Markdown table, as in docs/performance.md:
//! `palpate bench --json | cargo run --release --example bench_table`.

use serde::Deserialize;
use std::io::Read;

#[derive(Deserialize)]
struct Bench {
    results: Vec<Row>,
}

#[derive(Deserialize)]
struct Row {
    triangles: usize,
    regime: String,
    law: String,
    slip: String,
    partial_slip: bool,
    median_ns: f64,
    p99_ns: f64,
    p999_ns: f64,
}

fn main() -> anyhow::Result<()> {
    let mut json = String::new();
    std::io::stdin().read_to_string(&mut json)?;
    let Bench { results } = serde_json::from_str(&json)?;
    println!("| regime | triangles | law | slip rule | median (ns) | p99 (ns) | p99.9 (ns) |");
    println!("|---|---:|---|---|---:|---:|---:|");
    let mut regimes: Vec<&str> = results.iter().map(|row| row.regime.as_str()).collect();
    regimes.sort_unstable();
    regimes.dedup();
    for regime in regimes {
        for row in results.iter().filter(|row| row.regime == regime) {
            let Row { triangles, law, slip, partial_slip, median_ns, p99_ns, p999_ns, .. } = row;
            let partial = if *partial_slip { ", partial" } else { "" };
            anyhow::ensure!(
                [median_ns, p99_ns, p999_ns].iter().all(|ns| ns.is_finite() && **ns > 0.0),
                "{regime}"
            );
            println!(
                "| {regime} | {triangles} | {law} | {slip}{partial} | {median_ns:.0} | {p99_ns:.0} | {p999_ns:.0} |"
            );
        }
    }
    Ok(())
}
