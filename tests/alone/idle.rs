//! Accelerators leave no thread behind that keeps a processor busy, whether they exist or were
//! dropped. (Where other work keeps all processors busy, the test would not notice one.)

use crate::backends::{self, on_both};
use std::{fs, thread::sleep, time::Duration};

use glam::DVec3;
use lightpath::geometry::{Geometry, TriangleMesh};

/// Processor time of this process so far, in clock ticks of 10 ms.
fn ticks() -> u64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap();
    let (_, fields) = stat.rsplit_once(')').unwrap();
    let fields: Vec<&str> = fields.split_whitespace().collect();
    // Counted from the state, the third field: utime and stime.
    [11, 12].map(|i| fields[i].parse::<u64>().unwrap()).iter().sum()
}

on_both! {
fn no_thread_spins_after_accelerators_of_one_thread(backend: Backend) {
    let _alone = crate::alone();
    let vertices = (0..3000u32).map(|i| [i, i * 7 % 1000, i * 13 % 500].map(|x| x as f32));
    let triangles = (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriangleMesh::new(vertices.collect(), triangles, false);
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
    let build = || backends::build(&geometry, backend);
    let first = build();
    let second = build();
    drop(first);
    let third = build();
    let before = ticks();
    sleep(Duration::from_millis(500));
    let spent = ticks() - before;
    // A spinning thread takes 50 ticks.
    drop((second, third));
    assert!(spent <= 10, "{spent} ticks of 10 ms in half a second of sleep");
}
}
