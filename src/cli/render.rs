//! `orenx render`: images of a map, from a file or from a server.

mod viewpoints;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ArgGroup, Args};
use rayon::ThreadPool;
use tokio::runtime::Runtime;

use self::viewpoints::{Orbit, Viewpoint};
use super::credentials::CredentialArgs;
use super::open::{MapName, asking_runtime, is_url, open_view};
use crate::client::Questioner;
use crate::config::{BackendChoice, Renderer};
use crate::dataset::{cameras, pose};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{
    Camera, Encoding, MapView, Output, Painter, RenderSettings, SamplePosition, Subject,
    query_pool, render,
};
use crate::service::{ImageKind, ImageQuestion};
use crate::storage::write_file;

pub use self::viewpoints::Size;

/// Draw a map: color, depth, normals (PNG)
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("from").required(true).args(["poses", "pose", "orbit"])))]
pub struct RenderArgs {
    /// Map file, or the URL of a server, as in http://127.0.0.1:7611 or grpc://127.0.0.1:7610
    pub map: String,
    /// From each frame-*.pose.txt of a folder, with its camera-intrinsics.txt and the size of its
    /// depth images
    #[arg(long, value_name = "DIR", conflicts_with_all = ["size", "fov"])]
    pub poses: Option<PathBuf>,
    /// From one place: a file of 4x4 numbers, camera to world
    #[arg(long, value_name = "FILE")]
    pub pose: Option<PathBuf>,
    /// From N places around the middle of the map, looking at it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub orbit: Option<u32>,
    #[command(flatten)]
    pub circle: Orbit,
    #[arg(long, value_name = "WxH", default_value = "640x480")]
    pub size: Size,
    /// Angle of view between the left and the right side, degrees
    #[arg(long, value_name = "DEG", default_value_t = 75.0)]
    pub fov: f64,
    /// What to draw: color and depth by default, with --pose color alone
    #[arg(long, value_enum, value_delimiter = ',', value_name = "A,B")]
    pub outputs: Vec<Output>,
    /// tile is fast, ray the reference
    #[arg(long, value_enum, default_value = "tile")]
    pub renderer: Renderer,
    /// What draws a map file by tiles: cpu, the default; gpu, also one in software; auto, a GPU where
    /// there is a hardware one. A server draws on what it trains on
    #[arg(long, value_enum, default_value = "cpu")]
    pub backend: BackendChoice,
    /// Where on its way through a voxel a ray takes its color; for map files
    #[arg(long, value_enum, default_value = "zero-crossing")]
    pub sample: SamplePosition,
    /// A folder for NAME.OUTPUT.png; with --pose a file, F.png, or F.OUTPUT.png for several outputs
    #[arg(long, value_name = "DIR|F.png")]
    pub out: PathBuf,
    #[command(flatten)]
    name: MapName,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl RenderArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let mut outputs = self.outputs.clone();
        if outputs.is_empty() {
            let usual = [Output::Color, Output::Depth];
            outputs = usual[..if self.pose.is_some() { 1 } else { 2 }].to_vec();
        }
        let mut source = Source::open(&self)?;
        let viewpoints = self.viewpoints(&source)?;
        if self.pose.is_none() {
            std::fs::create_dir_all(&self.out).map_err(|e| Error::io(&self.out, e))?;
        }
        let mut out = std::io::stdout();
        for Viewpoint { name, camera } in &viewpoints {
            camera.check()?;
            for (output, image) in outputs.iter().zip(source.draw(camera, &outputs)?) {
                let path = self.path(name, *output, outputs.len());
                write_file(&path, |file| file.write_all(&image))?;
                if viewpoints.len() == 1 {
                    let k = &camera.intrinsics;
                    writeln!(out, "{}: {}x{} pixels", path.display(), k.width, k.height)?;
                }
            }
        }
        if viewpoints.len() > 1 {
            writeln!(out, "{}: {} views", self.out.display(), viewpoints.len())?;
        }
        Ok(())
    }

    fn viewpoints(&self, source: &Source) -> Result<Vec<Viewpoint>> {
        if let Some(folder) = &self.poses {
            let cameras = cameras(folder)?;
            let viewpoint = |(name, world_from_camera)| Viewpoint {
                name,
                camera: Camera { world_from_camera, intrinsics: cameras.intrinsics },
            };
            return Ok(cameras.poses.into_iter().map(viewpoint).collect());
        }
        let intrinsics = self.size.intrinsics(self.fov)?;
        let poses = match (&self.pose, self.orbit) {
            (Some(file), _) => vec![pose(file)?],
            (None, count) => self.circle.poses(count.unwrap_or(1), &source.bounds()?)?,
        };
        let viewpoint = |(at, world_from_camera)| Viewpoint {
            name: format!("frame-{at:06}"),
            camera: Camera { world_from_camera, intrinsics },
        };
        Ok(poses.into_iter().enumerate().map(viewpoint).collect())
    }

    /// Where an image goes.
    fn path(&self, name: &str, output: Output, outputs: usize) -> PathBuf {
        match self.pose.is_some() {
            true if outputs == 1 => self.out.clone(),
            true => self.out.with_extension(format!("{}.png", output.name())),
            false => self.out.join(format!("{name}.{}.png", output.name())),
        }
    }
}

/// Who draws.
enum Source {
    View {
        view: Arc<MapView>,
        pool: ThreadPool,
        settings: RenderSettings,
        /// `None`: the CPU draws.
        painter: Option<Box<Painter>>,
    },
    Server {
        client: Questioner,
        runtime: Runtime,
        map_id: String,
        renderer: Renderer,
    },
}

impl Source {
    fn open(arguments: &RenderArgs) -> Result<Self> {
        let RenderArgs { map, renderer, sample, backend, .. } = arguments;
        let (renderer, sample, backend) = (*renderer, *sample, *backend);
        let map_id = arguments.name.of(map)?;
        if backend == BackendChoice::Gpu && renderer == Renderer::Ray {
            let problem = "gpu draws by tiles; rays are walked on the CPU (--renderer ray)";
            return Err(Error::invalid("backend", problem));
        }
        if is_url(map) {
            if sample != SamplePosition::ZeroCrossing {
                return Err(Error::invalid("sample", "is for map files, not for servers"));
            }
            if backend != BackendChoice::Cpu {
                return Err(Error::invalid("backend", "is for map files, not for servers"));
            }
            let runtime = asking_runtime()?;
            let client =
                runtime.block_on(Questioner::connect_with(map, &arguments.credentials.read()?))?;
            return Ok(Self::Server { client, runtime, map_id, renderer });
        }
        let settings = RenderSettings { renderer, sample, ..RenderSettings::default() };
        let view = open_view(Path::new(map))?;
        let painter = match renderer {
            Renderer::Tile => Painter::open(backend)?.map(Box::new),
            Renderer::Ray => None,
        };
        Ok(Self::View { view, pool: query_pool(0)?, settings, painter })
    }

    fn bounds(&self) -> Result<Aabb> {
        match self {
            Self::View { view, .. } => Ok(view.bounds()),
            Self::Server { client, runtime, map_id, .. } => runtime.block_on(client.bounds(map_id)),
        }
    }

    /// PNG files, one an output.
    fn draw(&mut self, camera: &Camera, outputs: &[Output]) -> Result<Vec<Vec<u8>>> {
        match self {
            Self::View { view, pool, settings, painter } => {
                let channels = Output::channels(outputs.iter().copied());
                let never = || false;
                let rendering = match painter {
                    Some(gpu) => {
                        let subject = Subject { view, camera, channels, settings, text: None };
                        gpu.render(&subject, pool, &never)?.0
                    }
                    None => render(view, camera, channels, settings, pool, &never),
                };
                let rendering =
                    rendering.ok_or_else(|| Error::Internal("nobody asked to stop".into()))?;
                outputs.iter().map(|output| rendering.encode(*output, Encoding::Png)).collect()
            }
            Self::Server { client, runtime, map_id, renderer } => {
                let kind = |output: &Output| ImageKind { output: *output, encoding: Encoding::Png };
                let images = outputs.iter().map(kind).collect();
                let (map_id, renderer) = (map_id.clone(), *renderer);
                let question =
                    ImageQuestion { map_id, renderer, ..ImageQuestion::new(*camera, images) };
                let reply = runtime.block_on(client.render(&question))?;
                Ok(reply.images.into_iter().map(|(_, image)| image).collect())
            }
        }
    }
}
