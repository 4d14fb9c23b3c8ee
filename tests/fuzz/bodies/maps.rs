//! Map files, as they are loaded, and as snapshots come in from outside. What is loaded must also be
//! usable: it takes frames and edits, answers, and is drawn.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use glam::{DQuat, Vec3};
use orenx::config::Renderer;
use orenx::error::Result;
use orenx::frame::Frame;
use orenx::geometry::{Intrinsics, Pose, Region};
use orenx::map::{
    Camera, Channels, Clear, Edit, Fields, MapView, RenderSettings, query_pool, render,
};
use orenx::service::{Local, NearestQuestion, SliceQuestion};
use orenx::storage::{Mark, Summary, load_marked, load_view, save, save_marked};
use rayon::ThreadPool;

use super::{Layout, Target, scene};

pub(super) const TARGET: Target =
    Target { name: "maps", read, seeds, layout: Layout::Map, longest: 1 << 18 };

fn read(input: &[u8]) -> bool {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), input).unwrap();
    let (peeked, verified) = (Summary::peek(file.path()), Summary::verify(file.path()));
    if let (Ok(peeked), Ok(verified)) = (peeked, &verified) {
        assert_eq!(peeked, *verified);
    }
    let answers = load_view(file.path()).map(|view| look(&view));
    let goes_on = go_on(file.path());
    answers.is_ok() && (goes_on.is_ok() || verified.is_err())
}

/// Maps on: a frame, some refinement, an edit, and the frame again.
fn go_on(path: &Path) -> Result<()> {
    static FRAME: OnceLock<Frame> = OnceLock::new();
    let frame = FRAME.get_or_init(|| scene::frame(30));
    let (mut mapper, _) = load_marked(path, Ok)?;
    look(&mapper.publish());
    // What is left of a map may have no room for more, or features of another encoder.
    let _ = mapper.integrate(frame);
    mapper.refine(std::time::Duration::ZERO)?;
    let region = Some(Region::Sphere { center: Vec3::new(1.0, 0.0, 1.0), radius_m: 1.0 });
    mapper.edit(&Edit::Clear(Clear { region, ..Clear::default() }))?;
    let _ = mapper.integrate(frame);
    look(&mapper.publish_all()?);
    Ok(())
}

/// Asks and draws a little of a view.
pub(super) fn look(view: &Arc<MapView>) {
    static POOL: OnceLock<Arc<ThreadPool>> = OnceLock::new();
    let pool = POOL.get_or_init(|| Arc::new(query_pool(1).unwrap()));
    let bounds = view.bounds();
    let middle = [0.5 * (bounds.min + bounds.max), Vec3::new(0.0, 0.0, 1.0)]
        .into_iter()
        .find(|place| place.is_finite() && place.abs().max_element() < 1e4)
        .unwrap_or(Vec3::ZERO);
    let step = |i: usize| (i % 5) as f32 - 2.0;
    let points: Vec<Vec3> =
        (0..125).map(|i| middle + Vec3::new(step(i), step(i / 5), step(i / 25)) * 0.7).collect();
    let answers = view.query(&points, Fields::ALL);
    assert_eq!(answers.state.len(), points.len());
    view.surface_leaves();
    let local = Local::new(view.clone(), pool.clone());
    // As far as a map may reach, that is some hundred thousand cells.
    let resolution_m = if bounds.size().max_element() < 50.0 { 0.5 } else { 100.0 };
    let _ = local.get_slice(&SliceQuestion { z_m: 1.0, resolution_m, ..SliceQuestion::default() });
    let nearest = NearestQuestion { points: points[..4].to_vec(), ..NearestQuestion::default() };
    let _ = local.find_nearest(nearest);
    let camera = Camera {
        world_from_camera: Pose {
            rotation: DQuat::from_xyzw(-0.5, 0.5, -0.5, 0.5),
            translation: middle.as_dvec3(),
        },
        intrinsics: Intrinsics { fx: 8.0, fy: 8.0, cx: 3.5, cy: 2.5, width: 8, height: 6 },
    };
    for renderer in [Renderer::Tile, Renderer::Ray] {
        let settings = RenderSettings { renderer, ..RenderSettings::default() };
        render(view, &camera, Channels::ALL, &settings, pool, &|| false);
    }
}

fn seeds() -> Vec<Vec<u8>> {
    static SEEDS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    SEEDS.get_or_init(files).clone()
}

/// Checkpoints and compact maps, with all modalities and with few, of frames and empty.
fn files() -> Vec<Vec<u8>> {
    let bytes = |write: &dyn Fn(&Path) -> Result<()>| {
        let file = tempfile::NamedTempFile::new().unwrap();
        write(file.path()).unwrap();
        std::fs::read(file.path()).unwrap()
    };
    let frames = [scene::frame(10)];
    let few = orenx::config::MapSettings { modalities: vec!["sdf".into()], ..scene::settings() };
    let shining = orenx::config::MapSettings { color_degree: 1, ..scene::settings() };
    let mut all = Vec::new();
    for (settings, frames) in [
        (scene::settings(), &frames[..]),
        (few, &frames[..]),
        (shining, &frames[..]),
        (scene::settings(), &[]),
    ] {
        let mut mapper = scene::map(&settings, frames);
        let mark = Mark { journal: 7, position: 1 };
        all.push(bytes(&|path| save_marked(&mapper, mark, path)));
        let mapper = std::cell::RefCell::new(&mut mapper);
        all.push(bytes(&|path| save(&mut mapper.borrow_mut(), path, true)));
    }
    all
}
