//! A question in words: the line that asks it, and whether the answer is where the thing is.

use anyhow::ensure;

use crate::client::Client;
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::geometry::Aabb;
use crate::service::{FindQuestion, Sought};

pub(super) const QUESTION: &str = "where is the blanket?";
/// What is meant.
const CLASS: &str = "blanket";
/// How far from what the camera saw of it the middle of the answer may lie, m.
const TOLERANCE_M: f32 = 0.1;

/// A line to paste.
pub(super) fn line(program: &str, url: &str) -> String {
    format!("{program} ask {url} \"{QUESTION}\" --heat {CLASS}.png")
}

/// Asks it, and compares the best match with the room.
pub(super) async fn check(client: &Client, room: &Synthetic, epoch: u64) -> anyhow::Result<()> {
    let question = FindQuestion {
        top_k: 1,
        min_epoch: epoch,
        ..FindQuestion::new(Sought::words(&[QUESTION]))
    };
    let reply = client.find(&question).await?;
    let Some(best) = reply.findings.matches.first() else {
        anyhow::bail!("\"{QUESTION}\" found nothing");
    };
    let seen = seen(room)?;
    let off = (best.centroid - best.centroid.clamp(seen.min, seen.max)).length();
    println!(
        "\"{QUESTION}\": at ({:.2}, {:.2}, {:.2}), {:.1} × {:.1} × {:.1} m, score {:.2}, {:.1} ms",
        best.centroid.x,
        best.centroid.y,
        best.centroid.z,
        best.extent.x,
        best.extent.y,
        best.extent.z,
        best.score,
        reply.spent.as_secs_f32() * 1e3
    );
    ensure!(off <= TOLERANCE_M, "that is {off:.2} m from the {CLASS}");
    Ok(())
}

/// The box around what the camera saw of it.
fn seen(room: &Synthetic) -> anyhow::Result<Aabb> {
    let mut seen = Aabb::EMPTY;
    for index in (0..room.len()).step_by(10) {
        let (frame, labels) = (room.load(index, false)?, room.labels(index)?);
        let Some(labels) = labels else { continue };
        let id = labels.classes.iter().find(|class| class.name == CLASS).map(|class| class.id);
        for (pixel, _) in labels.ids.iter().enumerate().filter(|(_, at)| Some(**at) == id) {
            let (u, v) = (pixel as u32 % labels.width, pixel as u32 / labels.width);
            let z = frame.depth.at(u, v);
            if z > 0.0 {
                seen.extend(frame.world_point(u, v, z));
            }
        }
    }
    Ok(seen)
}
