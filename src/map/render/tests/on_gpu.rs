//! Images that the GPU draws against those of its twin, the CPU's tiles, on whatever adapter there
//! is: no adapter is a failure.

use super::*;
use crate::config::BackendChoice;
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::map::Mapper;
use crate::map::view::BLOCKS;

/// What two images may differ by: a GPU's exponential and its products differ in the last bits, and
/// so does on which side of an edge a ray passes. Software Vulkan: 67 dB and more, 0.001 mm.
const PSNR_DB: f64 = 50.0;
/// Mean difference of depth where both have one, m.
const DEPTH_M: f64 = 1e-5;
/// Mean difference of normals, and of opacity.
const NORMAL: f64 = 1e-3;
const OPACITY: f64 = 1e-4;
/// Share of pixels that only one has a surface at, or whose bit of the mask differs.
const DIFFERENT: f64 = 1e-3;

fn painter() -> Painter {
    Painter::open(BackendChoice::Gpu)
        .expect("an adapter: tests need a Vulkan driver, software will do")
        .expect("a GPU was asked for")
}

fn paint(painter: &mut Painter, view: &Arc<MapView>, camera: &Camera) -> Rendering {
    paint_with(painter, view, camera, &RenderSettings::default())
}

fn paint_with(
    painter: &mut Painter,
    view: &Arc<MapView>,
    camera: &Camera,
    settings: &RenderSettings,
) -> Rendering {
    let pool = query_pool(1).expect("threads");
    let subject = Subject { view, camera, channels: Channels::ALL, settings, text: None };
    let drawn = painter.render(&subject, &pool, &|| false);
    drawn.expect("a GPU").0.expect("not stopped")
}

/// How far two images lie apart.
#[derive(Debug)]
struct Apart {
    psnr_db: f64,
    depth_m: f64,
    normal: f64,
    opacity: f64,
    different: f64,
    /// Share of pixels that show a surface.
    covered: f64,
}

fn apart(gpu: &Rendering, cpu: &Rendering) -> Apart {
    assert_eq!((gpu.width, gpu.height), (cpu.width, cpu.height));
    let pixels = cpu.depth_m.len();
    for lengths in [
        [gpu.color.len(), cpu.color.len()],
        [gpu.depth_m.len(), pixels],
        [gpu.normal.len(), cpu.normal.len()],
        [gpu.opacity.len(), cpu.opacity.len()],
        [gpu.unknown.len(), cpu.unknown.len()],
    ] {
        assert_eq!(lengths[0], lengths[1]);
    }
    let both: Vec<usize> =
        (0..pixels).filter(|&i| gpu.depth_m[i] > 0.0 && cpu.depth_m[i] > 0.0).collect();
    let mean = |of: &dyn Fn(usize) -> f32, at: &[usize]| {
        at.iter().map(|&i| f64::from(of(i))).sum::<f64>() / at.len().max(1) as f64
    };
    let all: Vec<usize> = (0..pixels).collect();
    let squared = |i: usize| (gpu.color[i] - cpu.color[i]).length_squared() / 3.0;
    let differs = |i: usize| {
        let one_sided = (gpu.depth_m[i] > 0.0) != (cpu.depth_m[i] > 0.0);
        f32::from(u8::from(one_sided || gpu.unknown[i] != cpu.unknown[i]))
    };
    Apart {
        psnr_db: -10.0 * mean(&squared, &all).max(1e-12).log10(),
        depth_m: mean(&|i| (gpu.depth_m[i] - cpu.depth_m[i]).abs(), &both),
        normal: mean(&|i| (gpu.normal[i] - cpu.normal[i]).length(), &both),
        opacity: mean(&|i| (gpu.opacity[i] - cpu.opacity[i]).abs(), &all),
        different: mean(&differs, &all),
        covered: both.len() as f64 / pixels as f64,
    }
}

fn assert_same(name: &str, gpu: &Rendering, cpu: &Rendering) -> Apart {
    let apart = apart(gpu, cpu);
    println!("{name}: {apart:?}");
    let is_same = apart.psnr_db >= PSNR_DB
        && apart.depth_m <= DEPTH_M
        && apart.normal <= NORMAL
        && apart.opacity <= OPACITY
        && apart.different <= DIFFERENT;
    assert!(is_same, "{name}: {apart:?}");
    apart
}

/// A map of the synthetic room after some frames, and views from between them.
fn mapped(profile: Profile, frames: usize) -> (Mapper, Vec<Camera>) {
    mapped_with(MapSettings { profile, ..MapSettings::default() }, frames)
}

fn mapped_with(settings: MapSettings, frames: usize) -> (Mapper, Vec<Camera>) {
    let config = MapConfig::from_settings(&settings).expect("good");
    let mut mapper = Mapper::new(config).expect("an empty map");
    let room = Synthetic::room(60).with_width(96);
    for index in 0..frames {
        mapper.integrate(&room.load(index, true).expect("a frame")).expect("integrated");
    }
    let walk = Synthetic::room(120).with_width(112).with_height(72);
    let view = |frame: usize| Camera {
        world_from_camera: walk.pose(frame),
        intrinsics: walk.intrinsics(),
    };
    (mapper, [1, 9, 60].map(view).to_vec())
}

#[test]
fn images_of_a_mapped_room_are_those_of_the_cpu() {
    let mut painter = painter();
    let pool = query_pool(2).expect("threads");
    for profile in [Profile::Lite, Profile::Full] {
        let (mut mapper, cameras) = mapped(profile, 6);
        let view = mapper.publish_all().expect("a view");
        let learned = view.store.rows.pages().flat_map(|page| &page.rows);
        assert!(learned.filter(|row| row.features.sdf[0].0 != 0).count() > 100, "decoders matter");
        for (sample, camera) in
            [SamplePosition::ZeroCrossing, SamplePosition::Midpoint].into_iter().zip(&cameras)
        {
            let settings = RenderSettings { sample, ..RenderSettings::default() };
            let gpu = paint_with(&mut painter, &view, camera, &settings);
            let cpu = render(&view, camera, Channels::ALL, &settings, &pool, &|| false);
            let cpu = cpu.expect("not stopped");
            let apart = assert_same(&format!("{profile:?}, {sample:?}"), &gpu, &cpu);
            assert!(apart.covered > 0.5, "it shows the room");
            let colored = cpu.color.iter().filter(|color| color.max_element() > 0.0).count();
            assert!(colored * 2 > cpu.color.len(), "it has colours");
            let unknown = cpu.unknown.iter().filter(|&&bit| bit == 1).count();
            assert!(unknown > 0 && unknown < cpu.unknown.len(), "the mask has both");
        }
    }
}

#[test]
fn closed_forms_of_mixed_sizes_look_as_on_the_cpu_from_everywhere() {
    let mut painter = painter();
    let eyes = [
        DVec3::new(0.3, -0.2, 0.1),
        DVec3::new(0.0, 0.0, 0.0),
        DVec3::new(-1.0999, 0.11, 0.9),
        DVec3::new(-2.6, 0.4, 0.7),
        DVec3::new(0.1, 0.2, -0.3),
    ];
    for profile in [Profile::Lite, Profile::Full] {
        let view = Arc::new(view_in(profile, 1.6, room));
        for (i, eye) in eyes.into_iter().enumerate() {
            let target = DVec3::new(0.9, 0.5 - 0.4 * i as f64, 0.3 * i as f64 - 0.5);
            let camera = camera(eye, target, 52, 44);
            let cpu = draw(&view, &camera, Renderer::Tile);
            let apart = assert_same(
                &format!("{profile:?} {eye}"),
                &paint(&mut painter, &view, &camera),
                &cpu,
            );
            assert!(apart.covered > 0.3, "{eye}: {apart:?}");
        }
    }
}

/// From so far away that a tile has more cubes than are sorted in workgroup memory, and an image
/// more pairs than there was room for.
#[test]
fn a_tile_of_thousands_of_cubes_is_drawn_in_order() {
    let mut painter = painter();
    let view = Arc::new(view_in(Profile::Full, 1.6, room));
    let far = camera(DVec3::new(-9.0, 2.0, 3.0), DVec3::ZERO, 24, 20);
    let cpu = draw(&view, &far, Renderer::Tile);
    let apart = assert_same("far", &paint(&mut painter, &view, &far), &cpu);
    assert!(apart.covered > 0.05, "{apart:?}");
    assert!(painter.most_cubes_of_a_tile() > 2000, "{}", painter.most_cubes_of_a_tile());
}

#[test]
fn what_changes_from_epoch_to_epoch_is_drawn() {
    let settings = MapSettings { color_degree: 1, color_spacing_m: 0.1, ..MapSettings::default() };
    let (mut mapper, cameras) = mapped_with(settings, 2);
    let room = Synthetic::room(60).with_width(96);
    let mut following = painter();
    let mut harmonics = 0;
    let before = paint(&mut following, &mapper.publish_all().expect("a view"), &cameras[1]);
    for index in 2..5 {
        mapper.integrate(&room.load(index, true).expect("a frame")).expect("integrated");
        let view = mapper.publish_all().expect("a view");
        let image = paint(&mut following, &view, &cameras[1]);
        assert_same(&format!("epoch {index}"), &image, &draw(&view, &cameras[1], Renderer::Tile));
        // One that is told all at once draws the same, bit for bit.
        assert!(paint(&mut painter(), &view, &cameras[1]) == image, "epoch {index}");
        assert!(image != before);
        let known = known_harmonics(&view);
        assert!(known > harmonics, "{known} and {harmonics} of them");
        harmonics = known;
    }
}

/// How many harmonics of vertices are other than 0.
fn known_harmonics(view: &MapView) -> usize {
    let pages = 0..view.store.color_blocks.div_ceil(BLOCKS);
    let of_page = |page| view.store.colors.page(page).harmonics.iter();
    pages.flat_map(of_page).filter(|term| **term != [0; 3]).count()
}

/// A view of which harmonics alone are others: some for every vertex, in all terms.
fn with_other_harmonics(view: &MapView) -> Arc<MapView> {
    let mut store = view.store.clone();
    for page in 0..store.color_blocks.div_ceil(BLOCKS) {
        let terms = store.colors.write(page).harmonics.as_flattened_mut();
        terms.iter_mut().enumerate().for_each(|(i, term)| {
            *term = ((i + 7 * page) as i32 * 7919 % 11999) as i16 - 5999;
        });
    }
    Arc::new(MapView {
        epoch: view.epoch + 1,
        newest_stamp_ns: view.newest_stamp_ns,
        config: view.config.clone(),
        decoders: view.decoders.clone(),
        store,
        viewpoints: view.viewpoints.clone(),
    })
}

#[test]
fn colours_that_depend_on_the_direction_are_those_of_the_cpu() {
    let mut painter = painter();
    let cpu = |view: &Arc<MapView>, camera: &Camera| draw(view, camera, Renderer::Tile);
    for (color_degree, color_spacing_m) in [(1, 0.025), (2, 0.1), (2, 0.05), (3, 0.025)] {
        let settings = MapSettings { color_degree, color_spacing_m, ..MapSettings::default() };
        let (mut mapper, cameras) = mapped_with(settings, 4);
        let view = mapper.publish_all().expect("a view");
        let shown = cpu(&view, &cameras[1]);
        let image = paint(&mut painter, &view, &cameras[1]);
        assert_same(&format!("degree {color_degree}"), &image, &shown);
        // The next epoch has other harmonics, and nothing else that is new.
        let next = with_other_harmonics(&view);
        let after = cpu(&next, &cameras[1]);
        let change = apart(&after, &shown);
        assert!(
            change.psnr_db < PSNR_DB - 20.0 && change.depth_m == 0.0,
            "they matter: {change:?}"
        );
        let image = paint(&mut painter, &next, &cameras[1]);
        assert_same(&format!("degree {color_degree}, others"), &image, &after);
        // One that is told all at once draws the same, bit for bit.
        assert!(paint(&mut self::painter(), &next, &cameras[1]) == image, "degree {color_degree}");
    }
}

#[test]
fn maps_take_turns_and_those_that_nobody_draws_are_forgotten() {
    let mut painter = painter();
    let views: Vec<_> = (0..6)
        .map(|i| Arc::new(view_of(1.2, move |at| room(at * (1.0 + 0.02 * i as f32)))))
        .collect();
    let camera = camera(DVec3::new(0.3, -0.2, 0.1), DVec3::X, 24, 20);
    for view in views.iter().chain(&views) {
        let cpu = draw(view, &camera, Renderer::Tile);
        assert_same("in turn", &paint(&mut painter, view, &camera), &cpu);
    }
    assert_eq!(painter.held(), 4);
    assert!(painter.forget(std::time::Duration::from_secs(3600)));
    assert!(!painter.forget(std::time::Duration::ZERO));
    assert_eq!(painter.held(), 0);
    paint(&mut painter, &views[0], &camera);
}

#[test]
fn images_of_any_size_and_of_nothing_are_drawn_on_a_gpu() {
    let mut painter = painter();
    let (full, empty) = (Arc::new(view_of(0.6, ball)), Arc::new(view_of(0.0, ball)));
    for (width, height) in [(1, 1), (17, 3), (3, 35), (16, 16)] {
        let camera = camera(DVec3::new(2.0, 0.1, 0.1), DVec3::ZERO, width, height);
        for view in [&full, &empty] {
            let cpu = draw(view, &camera, Renderer::Tile);
            let image = paint(&mut painter, view, &camera);
            assert_eq!(image.unknown.len(), (width * height) as usize);
            if Arc::ptr_eq(view, &empty) {
                assert_eq!(image, cpu);
            } else {
                assert_same(&format!("{width}x{height}"), &image, &cpu);
            }
        }
    }
}

#[test]
fn columns_that_nobody_wants_are_not_brought_back() {
    let mut painter = painter();
    let view = Arc::new(view_of(1.2, ball));
    let camera = camera(DVec3::new(1.1, -0.2, 0.3), DVec3::ZERO, 40, 40);
    let pool = query_pool(1).expect("threads");
    let settings = RenderSettings::default();
    let all = paint(&mut painter, &view, &camera);
    let mut with = |channels, stop: bool| {
        let subject =
            Subject { view: &view, camera: &camera, channels, settings: &settings, text: None };
        painter.render(&subject, &pool, &|| stop).expect("a GPU").0
    };
    let none = with(Channels::NONE, false).expect("not stopped");
    assert_eq!(none, Rendering { width: 40, height: 40, ..Rendering::default() });
    let unknown = with(Channels { unknown: true, ..Channels::NONE }, false).expect("not stopped");
    assert!(unknown.depth_m.is_empty() && unknown.unknown == all.unknown);
    let normal = with(Channels { normal: true, ..Channels::NONE }, false).expect("not stopped");
    assert_eq!(normal.normal, all.normal);
    assert!(with(Channels::ALL, true).is_none());
}
