//! Images of the mapped room against the room.

use glam::Vec3;

use orenx::config::Renderer;
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::{self, Synthetic};
use orenx::map::{
    Camera, Channels, MapView, Mapper, RenderSettings, Rendering, SamplePosition, query_pool,
    render,
};

use super::lite;

const FRAMES: usize = 60;

fn mapped_room() -> std::sync::Arc<MapView> {
    let data = Synthetic::room(FRAMES).with_width(320);
    let mut mapper = Mapper::new(lite(0)).unwrap();
    for index in 0..FRAMES {
        mapper.integrate(&data.load(index, true).unwrap()).unwrap();
    }
    mapper.publish()
}

fn draw(view: &MapView, camera: &Camera, settings: RenderSettings) -> Rendering {
    let pool = query_pool(2).unwrap();
    camera.check().unwrap();
    settings.check().unwrap();
    render(view, camera, Channels::ALL, &settings, &pool, &|| false).unwrap()
}

/// Peak signal-to-noise ratio, dB.
fn psnr(pairs: impl Iterator<Item = (Vec3, Vec3)>) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in pairs {
        sum += (a - b).length_squared() / 3.0;
        count += 1.0;
    }
    -10.0 * (sum / count as f32).log10()
}

#[test]
fn the_room_looks_like_the_room() {
    let view = mapped_room();
    // Between frames, so that no view was mapped.
    let walk = Synthetic::room(2 * FRAMES).with_width(160);
    let truth = synthetic::Renderer::default();
    for frame in [31, 77] {
        let camera = Camera { world_from_camera: walk.pose(frame), intrinsics: walk.intrinsics() };
        let (depth, color) = truth.depth_and_color(
            walk.scene(frame),
            &camera.intrinsics,
            &camera.world_from_camera,
            walk.range_m(),
        );
        let rgb = |i: usize| Vec3::from([0, 1, 2].map(|c| f32::from(color.rgb[3 * i + c]))) / 255.0;
        let images = [Renderer::Ray, Renderer::Tile].map(|renderer| {
            let image = draw(&view, &camera, RenderSettings { renderer, ..Default::default() });
            let errors: Vec<f32> = image
                .depth_m
                .iter()
                .zip(&depth.metres)
                .filter(|(found, _)| **found > 0.0)
                .map(|(found, expected)| (found - expected).abs())
                .collect();
            let mut sorted = errors.clone();
            sorted.sort_unstable_by(f32::total_cmp);
            let covered = errors.len() as f32 / depth.metres.len() as f32;
            let (mean, middle) =
                (errors.iter().sum::<f32>() / errors.len() as f32, sorted[sorted.len() / 2]);
            let hit = (0..image.color.len()).filter(|i| image.depth_m[*i] > 0.0);
            let psnr = psnr(hit.map(|i| (image.color[i], rgb(i))));
            let unknown = image.unknown.iter().filter(|u| **u == 1).count() as f32;
            let unknown = unknown / image.unknown.len() as f32;
            let found = format!(
                "{renderer:?} {frame}: {mean} m, {middle} m in the middle, {psnr} dB, {covered} \
                 covered, {unknown} unknown"
            );
            assert!(mean < 0.01 && middle < 0.003, "{found}");
            assert!(psnr > 26.0 && covered > 0.98 && unknown < 0.2, "{found}");
            image
        });
        let [ray, tile] = &images;
        let alike = psnr(ray.color.iter().copied().zip(tile.color.iter().copied()));
        assert!(alike > 35.0, "{frame}: {alike} dB");
        let differ = ray.unknown.iter().zip(&tile.unknown).filter(|(a, b)| a != b).count();
        assert!(differ * 20 < ray.unknown.len(), "{differ} pixels");
        let opacity = ray.opacity.iter().zip(&tile.opacity).map(|(a, b)| (a - b).abs());
        assert!(opacity.sum::<f32>() < 0.01 * ray.opacity.len() as f32);
    }
}

#[test]
fn surfaces_stay_where_they_are_when_soft_and_move_with_samples_halfway_through_voxels() {
    let view = mapped_room();
    let walk = Synthetic::room(2 * FRAMES).with_width(64);
    let camera = Camera { world_from_camera: walk.pose(31), intrinsics: walk.intrinsics() };
    for renderer in [Renderer::Ray, Renderer::Tile] {
        let settings = RenderSettings { renderer, ..Default::default() };
        let sharp = draw(&view, &camera, settings);
        let soft = RenderSettings { sharpness: 40.0, ..settings };
        let midpoint = RenderSettings { sample: SamplePosition::Midpoint, ..settings };
        for (settings, range_m) in [(soft, 0.0..0.005), (midpoint, 0.005..0.1)] {
            let image = draw(&view, &camera, settings);
            let mut errors: Vec<f32> =
                image.depth_m.iter().zip(&sharp.depth_m).map(|(a, b)| (a - b).abs()).collect();
            errors.sort_unstable_by(f32::total_cmp);
            let middle = errors[errors.len() / 2];
            assert!(range_m.contains(&middle), "{settings:?}: {middle} m");
        }
    }
}
