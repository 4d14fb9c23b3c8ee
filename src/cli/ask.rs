//! `orenx ask`: where in a map is what some words mean?

mod picture;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use glam::{DQuat, DVec3, Vec3};
use serde::Serialize;

use self::picture::Picture;
use super::answerer::{Answerer, Heat};
use super::credentials::CredentialArgs;
use super::encoder::EncoderArgs;
use super::open::MapName;
use super::render::Size;
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Intrinsics, Pose};
use crate::map::{Camera, Findings, Match, Places};
use crate::numpy::ArchiveWriter;
use crate::serve::Found;
use crate::service::{FindQuestion, Sought};
use crate::storage::write_file;

/// How wide the view of the best match is, degrees.
const FOV: f64 = 75.0;
/// From where a match is looked at that no camera showed, m from its middle.
const BESIDE: DVec3 = DVec3::new(1.5, 1.5, 1.2);
/// The top view is taken from so many times the map's longer side above it: nearly without
/// perspective.
const HEIGHT: f64 = 4.0;
/// The share of the image that the map fills there.
const FILLED: f64 = 0.96;

/// Ask where something is, in words
#[derive(Debug, Args)]
pub struct AskArgs {
    /// Map file, or the URL of a server, as in http://127.0.0.1:7611 or grpc://127.0.0.1:7610
    pub map: String,
    /// What to look for; of several texts the one that fits a place best counts
    #[arg(required = true, value_name = "TEXT")]
    pub prompts: Vec<String>,
    /// What to compare with, instead of "object", "things", "stuff" and "texture"; may be repeated
    #[arg(long = "negative", value_name = "TEXT")]
    pub negatives: Vec<String>,
    /// Compare with nothing: scores are cosines, not relevancies
    #[arg(long, conflicts_with = "negatives")]
    pub no_negatives: bool,
    /// At most so many matches
    #[arg(long, value_name = "K", default_value_t = 5,
        value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub top: u32,
    /// Places that score less do not count; 0.5 by default, and 0.1 for cosines
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub min_score: Option<f32>,
    #[command(flatten)]
    name: MapName,
    #[command(flatten)]
    encoder: EncoderArgs,
    #[command(flatten)]
    credentials: CredentialArgs,
    /// Matches as JSON
    #[arg(long)]
    pub json: bool,
    /// Draw the best match from where it was seen best, with what fits in warm colors
    #[arg(long, value_name = "FILE.png")]
    pub heat: Option<PathBuf>,
    /// Draw the map from above, with what fits in warm colors and a box around each match
    #[arg(long, value_name = "FILE.png")]
    pub top_view: Option<PathBuf>,
    /// Write every place that fits: points, (N, 3), and score; with --min-score -1 the whole map
    #[arg(long, value_name = "FILE.npz")]
    pub places: Option<PathBuf>,
    /// Of the images
    #[arg(long, value_name = "WxH", default_value = "640x480")]
    pub size: Size,
}

impl AskArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let answerer = Answerer::open(&self.map, &self.name, &self.encoder, &self.credentials)?;
        let start = Instant::now();
        let question = self.question(&answerer)?;
        let Findings { matches, places } = answerer.find(&question)?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let mut out = std::io::stdout();
        if self.json {
            writeln!(out, "{}", as_json(&matches, milliseconds)?)?;
        } else {
            write!(out, "{}", as_table(&matches, milliseconds))?;
        }
        if let Some(path) = &self.places {
            write_places(path, &places)?;
        }
        if self.heat.is_some() || self.top_view.is_some() {
            self.draw(&answerer, &question, &matches)?;
        }
        Ok(())
    }

    fn question(&self, answerer: &Answerer) -> Result<FindQuestion> {
        let negatives = match (self.no_negatives, self.negatives.is_empty()) {
            (true, _) => Some(Vec::new()),
            (false, true) => None,
            (false, false) => Some(self.negatives.clone()),
        };
        let words = Sought::Words { prompts: self.prompts.clone(), negatives };
        Ok(FindQuestion {
            top_k: self.top as usize,
            min_score: self.min_score,
            places: self.places.is_some(),
            ..FindQuestion::new(answerer.sought(words, "prompts")?)
        })
    }

    fn draw(&self, answerer: &Answerer, question: &FindQuestion, matches: &[Match]) -> Result<()> {
        let bounds = answerer.bounds()?;
        if bounds.is_empty() {
            return Err(Error::FailedPrecondition("the map is empty: nothing to draw".into()));
        }
        let least = question.settings()?.min_score;
        let most = matches.first().map_or(1.0, |best| best.score);
        let tinted = |camera: &Camera| -> Result<Picture> {
            let Heat { color, scores } = answerer.draw(camera, &question.sought)?;
            Ok(Picture::tinted(self.size, &color, &scores, [least, most]))
        };
        if let Some(path) = &self.heat {
            let camera = match matches.first() {
                Some(best) => Camera {
                    world_from_camera: best.best_view.unwrap_or_else(|| beside(best)),
                    intrinsics: self.size.intrinsics(FOV)?,
                },
                None => self.above(&bounds),
            };
            let file = tinted(&camera)?.png()?;
            write_file(path, |out| out.write_all(&file))?;
        }
        if let Some(path) = &self.top_view {
            let camera = self.above(&bounds);
            let mut picture = tinted(&camera)?;
            for (at, found) in matches.iter().enumerate() {
                picture.frame(&camera, &found.obb, &(at + 1).to_string());
            }
            let file = picture.png()?;
            write_file(path, |out| out.write_all(&file))?;
        }
        Ok(())
    }

    /// A camera far above the middle of `bounds` that has all of it in its image, y up. A ceiling
    /// turns its back on it, and is not drawn.
    fn above(&self, bounds: &Aabb) -> Camera {
        let Size { width, height } = self.size;
        let (middle, size) = (0.5 * (bounds.min + bounds.max).as_dvec3(), bounds.size().as_dvec3());
        let above = HEIGHT * size.x.max(size.y).max(1.0);
        let per_metre =
            FILLED * (f64::from(width) / size.x.max(0.1)).min(f64::from(height) / size.y.max(0.1));
        let focal = per_metre * above;
        let centre = |side: u32| 0.5 * (f64::from(side) - 1.0);
        Camera {
            world_from_camera: Pose {
                rotation: DQuat::from_rotation_x(std::f64::consts::PI),
                translation: DVec3::new(middle.x, middle.y, f64::from(bounds.max.z) + above),
            },
            intrinsics: Intrinsics {
                fx: focal,
                fy: focal,
                cx: centre(width),
                cy: centre(height),
                width,
                height,
            },
        }
    }
}

fn beside(found: &Match) -> Pose {
    let middle = found.centroid.as_dvec3();
    Pose::looking_at(middle + BESIDE, middle, DVec3::Z)
}

fn write_places(path: &Path, places: &Places) -> Result<()> {
    let points: &[f32] = bytemuck::cast_slice(&places.points);
    write_file(path, |file| {
        let mut archive = ArchiveWriter::new(file);
        archive.add("points", &[places.points.len(), 3], points)?;
        archive.add("score", &[places.scores.len()], &places.scores)?;
        archive.finish().map(drop)
    })
}

/// What `--json` prints.
#[derive(Serialize)]
struct Answer {
    matches: Vec<Found>,
    milliseconds: f64,
}

fn as_json(matches: &[Match], milliseconds: f64) -> Result<String> {
    let answer = Answer { matches: matches.iter().map(Found::from).collect(), milliseconds };
    serde_json::to_string(&answer)
        .map_err(|e| Error::Internal(format!("an answer did not become JSON: {e}")))
}

fn as_table(matches: &[Match], milliseconds: f64) -> String {
    let mut text = format!("{} found in {milliseconds:.1} ms\n", matches.len());
    if !matches.is_empty() {
        text += "  #  score        at x y z, m         size x y z, m   voxels\n";
    }
    for (at, found) in matches.iter().enumerate() {
        let three = |v: Vec3| format!("{:6.2} {:6.2} {:6.2}", v.x, v.y, v.z);
        text += &format!(
            "{:3}  {:5.3}  {}  {}  {:7}\n",
            at + 1,
            found.score,
            three(found.centroid),
            three(found.extent),
            found.voxels
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use clap::FromArgMatches;
    use glam::Quat;
    use serde_json::{Value, json};

    use super::*;
    use crate::map::OrientedBox;

    fn arguments(words: &[&str]) -> AskArgs {
        let matches = AskArgs::augment_args(clap::Command::new("ask"))
            .get_matches_from(["ask", "map.orenx"].iter().chain(words));
        AskArgs::from_arg_matches(&matches).expect("flags")
    }

    fn found() -> Match {
        let half_size = Vec3::new(0.25, 0.5, 0.4);
        Match {
            id: 0,
            score: 0.875,
            centroid: Vec3::new(1.0, -2.5, 0.5),
            obb: OrientedBox { center: Vec3::X, rotation: Quat::IDENTITY, half_size },
            extent: 2.0 * half_size,
            voxels: 40,
            best_view: None,
        }
    }

    #[test]
    fn a_match_is_a_line_or_an_object() {
        let text = as_table(&[found()], 12.34);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "1 found in 12.3 ms");
        assert_eq!(lines[2], "  1  0.875    1.00  -2.50   0.50    0.50   1.00   0.80       40");
        assert_eq!(as_table(&[], 1.0), "0 found in 1.0 ms\n");
        let text = as_json(&[found()], 12.5).expect("JSON");
        assert!(text.contains(r#""extent_m":[0.5,1.0,0.8],"voxels":40,"#), "{text}");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(json["milliseconds"], 12.5);
        let found = &json["matches"][0];
        assert_eq!(found["centroid_m"], json!([1.0, -2.5, 0.5]));
        assert_eq!(found["extent_m"], json!([0.5, 1.0, 0.8]));
        assert_eq!((&found["score"], &found["voxels"]), (&json!(0.875), &json!(40)));
        assert_eq!(found["best_view"], Value::Null);
    }

    #[test]
    fn a_camera_above_has_the_whole_map_in_its_image() {
        let arguments = arguments(&["chair", "--size", "200x100"]);
        let bounds = Aabb { min: Vec3::new(-1.0, 2.0, 0.0), max: Vec3::new(5.0, 6.0, 2.5) };
        let camera = arguments.above(&bounds);
        camera.check().expect("a camera");
        let k = camera.intrinsics;
        let own = camera.world_from_camera.inverse();
        let pixel = |point: Vec3| {
            let p = own.transform(point.as_dvec3());
            [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy]
        };
        let [low, high] = [pixel(bounds.min), pixel(bounds.max)];
        assert!(low[0] > 0.0 && high[0] < 199.0 && high[1] > 0.0 && low[1] < 99.0);
        assert!(low[0] < high[0] && high[1] < low[1], "x to the right, y up");
        assert!(high[1] < 5.0, "the narrower side fills the image: {high:?}");
    }
}
