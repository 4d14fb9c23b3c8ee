//! Views drawn on the GPU: a copy of what a view holds is kept there, and follows from epoch to
//! epoch.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::ThreadPool;

use super::tile::{lens, raster, shade};
use super::{Camera, Channels, Job, RenderSettings, Renderer, Rendering, SamplePosition, heat};
use super::{near, patch, render_with, unknown};
use crate::backend::{
    Adapters, BlockRecord, Extent, GpuRenderer, GpuScene, NodeRecord, Planes, Rules, Shot, Times,
    Wanted,
};
use crate::config::BackendChoice;
use crate::error::{Error, Result};
use crate::map::language::Scorer;
use crate::map::view::{
    BLOCKS, BRICKS, BrickPage, ColorPage, MapView, NODES, NodePage, ROWS, RowPage, Store,
};
use crate::modality::radiance::{TexelSource, harmonics};
use crate::surface::Lattice;

/// Maps that are held on the GPU at a time; the one that was not drawn for longest gives way.
const MOST_MAPS: usize = 4;

/// Who draws views on a GPU.
pub struct Painter {
    renderer: GpuRenderer,
    followed: Vec<Followed>,
}

/// A map that is held, as its view was.
struct Followed {
    view: Arc<MapView>,
    scene: GpuScene,
    drawn: Instant,
}

/// What an image is taken of, and which.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    pub view: &'a Arc<MapView>,
    /// A checked camera.
    pub camera: &'a Camera,
    pub channels: Channels,
    pub settings: &'a RenderSettings,
    /// Made by [`MapView::scorer`] of this view.
    pub text: Option<&'a Scorer>,
}

/// What was drawn, and the time of each pass by the GPU's own clock, ms; of no passes where the GPU
/// has no clock, or the CPU drew.
pub type Painted = (Option<Rendering>, Times);

const RULES: Rules = Rules {
    half_diagonal: near::HALF_DIAGONAL,
    learned_m: near::LEARNED_M,
    nearest_m: lens::NEAREST_M,
    slack: lens::SLACK,
    touch: raster::TOUCH,
    least_direction: raster::LEAST_DIRECTION,
    least_weight: raster::LEAST_WEIGHT,
    refinements: raster::REFINEMENTS as u32,
    rim: patch::RIM,
    beside_m: patch::BESIDE_M,
    beside_weight: patch::BESIDE_WEIGHT,
    block: shade::BLOCK,
    shortest_m: unknown::SHORTEST_M,
    step_m: unknown::STEP_M,
};

impl Painter {
    /// A painter as a choice says: `None` for the CPU, and with [`BackendChoice::Auto`] where there
    /// is no hardware adapter that can be used.
    pub fn open(choice: BackendChoice) -> Result<Option<Self>> {
        let open = |adapters| Self::on(adapters).map(Some);
        match choice {
            BackendChoice::Cpu => Ok(None),
            BackendChoice::Gpu => open(Adapters::Any),
            BackendChoice::Auto => open(Adapters::Hardware).or_else(|reason| {
                tracing::info!(%reason, "images are drawn on the CPU");
                Ok(None)
            }),
        }
    }

    fn on(adapters: Adapters) -> Result<Self> {
        let renderer = GpuRenderer::open(adapters, RULES)?;
        tracing::info!(gpu = renderer.adapter(), "images are drawn on a GPU");
        Ok(Self { renderer, followed: Vec::new() })
    }

    /// The GPU's name.
    pub fn adapter(&self) -> &str {
        self.renderer.adapter()
    }

    /// Draws a view, as [`super::render_with`] does; by rays on the CPU. `None` if `interrupted`.
    pub fn render(
        &mut self,
        subject: &Subject<'_>,
        pool: &ThreadPool,
        interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Painted> {
        let Subject { view, camera, channels, settings, text } = *subject;
        if settings.renderer == Renderer::Ray {
            let image = render_with(view, camera, channels, settings, text, pool, interrupted);
            return Ok((image, Times::new()));
        }
        self.follow(view, settings)?;
        if interrupted() {
            return Ok((None, Times::new()));
        }
        let text = text.filter(|_| channels.heat);
        // Heat is that of the surface.
        let drawn = Channels { depth: channels.depth || text.is_some(), ..channels };
        let shot = shot(camera, drawn, settings);
        let (planes, times) = self.renderer.draw(newest(&self.followed)?, &shot)?;
        let mut image = rendering(camera, planes);
        if let Some(text) = text {
            let job = Job { view, rays: camera.rays(), channels: drawn, settings: *settings };
            let Some(scores) = heat::scores(&job, &image.depth_m, text, pool, interrupted) else {
                return Ok((None, times));
            };
            image.heat = scores;
        }
        if !channels.depth {
            image.depth_m = Vec::new();
        }
        Ok((Some(image), times))
    }

    /// Draws a view by tiles a number of times, leaves the images on the GPU, and waits until they
    /// are done: what drawing alone takes.
    pub fn draw_only(&mut self, subject: &Subject<'_>, times: u32) -> Result<()> {
        let Subject { view, camera, channels, settings, .. } = *subject;
        self.follow(view, settings)?;
        let shot = shot(camera, channels, settings);
        self.renderer.draw_only(newest(&self.followed)?, &shot, times)
    }

    /// Brings the GPU's copy up to a view, if it holds another one or none.
    pub fn follow(&mut self, view: &Arc<MapView>, settings: &RenderSettings) -> Result<()> {
        let is_of_map = |f: &Followed| Arc::ptr_eq(&f.view.config, &view.config);
        // What was told of a later view is not taken back.
        self.followed.retain(|f| !is_of_map(f) || f.view.epoch <= view.epoch);
        let (mut scene, old) = match self.followed.iter().position(is_of_map) {
            Some(at) => {
                let followed = self.followed.swap_remove(at);
                (followed.scene, Some(followed.view))
            }
            None => {
                self.make_room();
                (self.renderer.scene()?, None)
            }
        };
        let is_same = old.as_ref().is_some_and(|old| Arc::ptr_eq(old, view));
        if !is_same {
            self.write(&mut scene, view, old.as_deref())?;
        }
        if !GpuRenderer::is_settled(&scene, settings.sharpness) {
            self.renderer.settle(&mut scene, &view.decoders.sdf, settings.sharpness)?;
        }
        self.followed.push(Followed { view: view.clone(), scene, drawn: Instant::now() });
        Ok(())
    }

    /// Lets go of maps that were not drawn for so long, with the views that they hold on to;
    /// whether any are left.
    pub fn forget(&mut self, unused: Duration) -> bool {
        self.followed.retain(|followed| followed.drawn.elapsed() < unused);
        !self.followed.is_empty()
    }

    fn make_room(&mut self) {
        while self.followed.len() >= MOST_MAPS {
            let oldest = (0..self.followed.len()).min_by_key(|&i| self.followed[i].drawn);
            let Some(oldest) = oldest else { return };
            self.followed.swap_remove(oldest);
        }
    }

    /// Writes what a view does not share with the one before it.
    fn write(&self, scene: &mut GpuScene, view: &MapView, old: Option<&MapView>) -> Result<()> {
        let (store, before) = (&view.store, old.map(|old| &old.store));
        self.renderer.begin(scene, &extent(view))?;
        self.renderer.write_nodes(scene, changed_nodes(store, before))?;
        self.renderer.write_rows(scene, changed_rows(store, before))?;
        self.renderer.write_bricks(scene, changed_bricks(store, before))?;
        self.renderer.write_blocks(scene, changed_blocks(store, before))?;
        if old.is_none_or(|old| !Arc::ptr_eq(&old.decoders, &view.decoders)) {
            self.renderer.write_decoder(scene, &view.decoders.sdf)?;
        }
        Ok(())
    }
}

#[cfg(test)]
impl Painter {
    /// Loses the device.
    pub(crate) fn break_down(&self, why: &str) {
        self.renderer.break_down(why);
    }

    /// How many maps are held.
    pub(super) fn held(&self) -> usize {
        self.followed.len()
    }

    /// Most cubes of a tile of the last image.
    pub(super) fn most_cubes_of_a_tile(&self) -> u32 {
        self.renderer.most_cubes_of_a_tile()
    }
}

/// The scene that was followed last.
fn newest(followed: &[Followed]) -> Result<&GpuScene> {
    let newest = followed.last().map(|followed| &followed.scene);
    newest.ok_or_else(|| Error::Internal("a view is drawn before it is followed".into()))
}

fn extent(view: &MapView) -> Extent {
    let store = &view.store;
    Extent {
        root: store.root,
        unit_m: store.unit_m,
        surface_log2: Lattice::new(&view.config).surface(),
        cell_m: store.cell_m,
        band: store.band,
        harmonics: harmonics(store.degree()),
        nodes: store.node_slots,
        rows: store.rows.len() * ROWS,
        bricks: store.bricks.len() * BRICKS,
        blocks: store.color_blocks,
    }
}

fn shot(camera: &Camera, channels: Channels, settings: &RenderSettings) -> Shot {
    let rays = camera.rays();
    Shot {
        eye: rays.eye,
        rotation: rays.rotation,
        intrinsics: rays.intrinsics,
        sharpness: settings.sharpness,
        midpoint: settings.sample == SamplePosition::Midpoint,
        wanted: Wanted {
            color: channels.color,
            depth: channels.depth,
            normal: channels.normal,
            opacity: channels.opacity,
            unknown: channels.unknown,
        },
    }
}

fn rendering(camera: &Camera, planes: Planes) -> Rendering {
    let Planes { color, depth_m, normal, opacity, unknown } = planes;
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    Rendering { width, height, color, depth_m, normal, opacity, unknown, heat: Vec::new() }
}

fn changed_nodes<'a>(
    new: &'a Store,
    old: Option<&'a Store>,
) -> impl Iterator<Item = (u32, NodeRecord)> {
    let record = |page: &NodePage, i: usize| {
        let node = &page.nodes[i];
        NodeRecord {
            link: page.children[i],
            corners: node.corners,
            low: node.low,
            log2_size: (node.log2_size != u8::MAX).then_some(node.log2_size),
            brick: node.brick,
            block: node.block,
        }
    };
    let empty = Arc::new(NodePage::default());
    new.nodes.changed(old.map(|old| &old.nodes)).flat_map(move |(at, page, before)| {
        let empty = empty.clone();
        (0..NODES).filter_map(move |i| {
            let (new, old) = (record(page, i), record(before.unwrap_or(&empty), i));
            (new != old).then_some(((at * NODES + i) as u32, new))
        })
    })
}

fn changed_rows<'a>(
    new: &'a Store,
    old: Option<&'a Store>,
) -> impl Iterator<Item = (u32, &'a crate::modality::Row)> {
    let empty = Arc::new(RowPage::default());
    new.rows.changed(old.map(|old| &old.rows)).flat_map(move |(at, page, before)| {
        let empty = empty.clone();
        (0..ROWS).filter_map(move |i| {
            let (new, old) = (&page.rows[i], &before.unwrap_or(&empty).rows[i]);
            // By bytes: a NaN is like itself, and -0 is not 0.
            let is_same = bytemuck::bytes_of(new) == bytemuck::bytes_of(old);
            (!is_same).then_some(((at * ROWS + i) as u32, new))
        })
    })
}

fn changed_bricks<'a>(
    new: &'a Store,
    old: Option<&'a Store>,
) -> impl Iterator<Item = (u32, &'a crate::surface::Known)> {
    let empty = Arc::new(BrickPage::default());
    new.bricks.changed(old.map(|old| &old.bricks)).flat_map(move |(at, page, before)| {
        let empty = empty.clone();
        (0..BRICKS).filter_map(move |i| {
            let is_same = page.known[i] == before.unwrap_or(&empty).known[i];
            (!is_same).then_some(((at * BRICKS + i) as u32, &page.known[i]))
        })
    })
}

fn changed_blocks<'a>(
    new: &'a Store,
    old: Option<&'a Store>,
) -> impl Iterator<Item = (u32, BlockRecord<'a>)> {
    let (vertices, blocks) = (new.band.vertices(), new.color_blocks);
    let width = vertices * harmonics(new.degree());
    new.colors.changed(old.map(|old| &old.colors)).flat_map(move |(at, page, before)| {
        let here = blocks.saturating_sub(at * BLOCKS).min(BLOCKS);
        (0..here).filter_map(move |i| {
            let record = |page: &'a ColorPage| {
                let texels = page.texels.get(i * vertices..(i + 1) * vertices)?;
                let harmonics = page.harmonics.get(i * width..(i + 1) * width)?;
                Some(BlockRecord { uppers: &page.uppers[i], texels, harmonics })
            };
            let block = record(page)?;
            (before.and_then(record) != Some(block)).then_some(((at * BLOCKS + i) as u32, block))
        })
    })
}
