//! Progress of a batch over all its frames.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use serde_json::json;

use crate::batch::Status;
use crate::units;

use crate::cli::progress::Reading;

/// Returns a meter for a batch. The remaining time is estimated from the frames rendered so far.
pub fn meter(status: &Arc<Status>) -> impl FnMut() -> Reading + Send + use<> {
    let (status, start) = (Arc::clone(status), Instant::now());
    move || {
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Relaxed);
        let (total, rendered) = (count(&status.total), count(&status.rendered));
        let (kept, failed) = (count(&status.kept), count(&status.failed));
        let (parts, more_rays) = status.under_way();
        let elapsed_s = start.elapsed().as_secs_f64();
        let rays = count(&status.rays) + more_rays;
        let settled = status.settled() as f64 + parts;
        let rendering = rendered as f64 + parts;
        let left = (total as f64 - settled).max(0.0);
        let eta_s = (rendering > 0.0).then(|| left * elapsed_s / rendering);
        let mut message = format!("{} of {}", units::count(status.settled()), units::count(total));
        if failed > 0 {
            message += &format!(", {} failed", units::count(failed));
        }
        message += &format!("  {:.1} Mray/s", rays as f64 / elapsed_s.max(1e-3) / 1e6);
        if let Some(eta) = eta_s {
            message += &format!("  ETA {}", units::duration(eta));
        }
        Reading {
            label: "frames".to_string(),
            // Unit: a thousandth of a frame.
            done: (1000.0 * settled) as u64,
            total: 1000 * total,
            overall: match status.settled() {
                // An empty batch is one that has not started.
                _ if total == 0 => 0.0,
                all if all >= total => 1.0,
                // Stays below 100% until the files of the last frame have their final names.
                _ => (settled / total as f64).min(0.99),
            },
            message,
            json: json!({
                "total": total, "rendered": rendered, "kept": kept, "failed": failed,
                "under_way": parts, "rays": rays, "elapsed_s": elapsed_s, "eta_s": eta_s,
            }),
        }
    }
}
