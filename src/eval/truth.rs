//! The truth folder: exact distances, surface points, the true mesh and unseen views, each optional.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::Vec3;

use crate::dataset;
use crate::error::{Error, Result};
use crate::map::TriangleMesh;
use crate::numpy::Archive;

/// What a folder knows about a scene.
#[derive(Debug, Clone, Default)]
pub struct Truth {
    pub sdf: Option<SdfTruth>,
    pub surface: Option<SurfaceTruth>,
    /// The folder of views that no frame was mapped from, `novel/`.
    pub novel: Option<PathBuf>,
    /// Those of the folder and of `novel/` whose views have labels, `labels.json`.
    pub labelled: Vec<PathBuf>,
}

/// `gt_sdf.npz`: the exact field at sampled points, column by column.
#[derive(Debug, Clone)]
pub struct SdfTruth {
    /// World metres.
    pub points: Vec<Vec3>,
    /// Signed distance, m.
    pub distances: Vec<f32>,
    pub gradients: Vec<Vec3>,
    /// |distance| ≤ 0.1 m.
    pub near: Vec<bool>,
    /// Whether some frame saw the nearest surface.
    pub closest_observed: Vec<bool>,
}

/// `gt_surface.npz` and `mesh.ply`: the true surface.
#[derive(Debug, Clone)]
pub struct SurfaceTruth {
    /// Samples of the surface that some frame saw, world metres.
    pub observed_points: Vec<Vec3>,
    pub mesh: TriangleMesh,
}

impl Truth {
    /// Reads what the folder has. A file that is there but broken is an error; the surface needs
    /// both of its files.
    pub fn load(folder: &Path) -> Result<Self> {
        if !folder.is_dir() {
            return Err(Error::NotFound { what: format!("truth folder {}", folder.display()) });
        }
        let at = |name: &str| Some(folder.join(name)).filter(|path| path.exists());
        let sdf = at("gt_sdf.npz").map(|path| SdfTruth::load(&path)).transpose()?;
        let surface = match (at("gt_surface.npz"), at("mesh.ply")) {
            (Some(points), Some(mesh)) => Some(SurfaceTruth::load(&points, &mesh)?),
            _ => None,
        };
        let novel = at("novel");
        let folders = [Some(folder.to_path_buf()), novel.clone()].into_iter().flatten();
        let labelled = folders.filter(|folder| dataset::has_labels(folder)).collect();
        Ok(Self { sdf, surface, novel, labelled })
    }

    /// Whether there is nothing to judge by.
    pub(super) fn is_empty(&self) -> bool {
        let nothing = self.sdf.is_none() && self.surface.is_none() && self.novel.is_none();
        nothing && self.labelled.is_empty()
    }
}

impl SdfTruth {
    fn load(path: &Path) -> Result<Self> {
        let mut archive = open(path)?;
        let truth = Self {
            points: vectors(&archive.rows("points", 3)?),
            distances: archive.rows("sdf", 1)?,
            gradients: vectors(&archive.rows("grad", 3)?),
            near: archive.rows("near", 1)?,
            closest_observed: archive.rows("closest_observed", 1)?,
        };
        truth.check(&path.display().to_string())?;
        Ok(truth)
    }

    fn check(&self, name: &str) -> Result<()> {
        let n = self.points.len();
        if n == 0 {
            return Err(Error::invalid(name, "holds no points"));
        }
        for (key, length) in [
            ("sdf", self.distances.len()),
            ("grad", self.gradients.len()),
            ("near", self.near.len()),
            ("closest_observed", self.closest_observed.len()),
        ] {
            if length != n {
                return Err(Error::invalid(
                    format!("{name}[{key}]"),
                    format!("has {length} rows, but points has {n}"),
                ));
            }
        }
        let finite = |i: usize| {
            self.points[i].is_finite()
                && self.distances[i].is_finite()
                && self.gradients[i].is_finite()
        };
        match (0..n).find(|&i| !finite(i)) {
            None => Ok(()),
            Some(i) => Err(Error::invalid(name, format!("row {i} is not finite"))),
        }
    }
}

impl SurfaceTruth {
    fn load(points: &Path, mesh: &Path) -> Result<Self> {
        let mut archive = open(points)?;
        let all = vectors(&archive.rows("points", 3)?);
        let observed: Vec<bool> = archive.rows("observed", 1)?;
        let name = points.display();
        if all.len() != observed.len() {
            return Err(Error::invalid(
                format!("{name}[observed]"),
                format!("has {} rows, but points has {}", observed.len(), all.len()),
            ));
        }
        let observed_points: Vec<Vec3> =
            all.iter().zip(observed).filter_map(|(p, seen)| seen.then_some(*p)).collect();
        if observed_points.is_empty() || !observed_points.iter().all(|p| p.is_finite()) {
            return Err(Error::invalid(
                format!("{name}[points]"),
                "needs at least one observed point, and finite numbers",
            ));
        }
        let file = File::open(mesh).map_err(|e| Error::io(mesh, e))?;
        let mesh_name = mesh.display().to_string();
        let mesh = TriangleMesh::read_ply(BufReader::new(file), &mesh_name)?;
        if mesh.triangles.is_empty() {
            return Err(Error::invalid(mesh_name, "holds no triangles"));
        }
        Ok(Self { observed_points, mesh })
    }
}

fn open(path: &Path) -> Result<Archive<BufReader<File>>> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    Archive::new(BufReader::new(file), path.display().to_string())
}

fn vectors(flat: &[f32]) -> Vec<Vec3> {
    flat.chunks_exact(3).map(Vec3::from_slice).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numpy::{ArchiveWriter, Value};

    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            Self(tempfile::tempdir().expect("a folder"))
        }

        fn archive(&self, name: &str) -> ArchiveWriter<File> {
            ArchiveWriter::new(File::create(self.0.path().join(name)).expect("a file"))
        }

        fn load(&self) -> Result<Truth> {
            Truth::load(self.0.path())
        }
    }

    fn add<T: Value>(archive: &mut ArchiveWriter<File>, key: &str, shape: &[usize], data: &[T]) {
        archive.add(key, shape, data).expect("written");
    }

    fn write_sdf(folder: &Folder, grad_rows: usize, x: f32) {
        let mut archive = folder.archive("gt_sdf.npz");
        add(&mut archive, "points", &[2, 3], &[x, 0.0, 0.0, 1.0, 0.0, 0.0]);
        add(&mut archive, "sdf", &[2], &[0.05f32, 0.5]);
        add(&mut archive, "grad", &[grad_rows, 3], &vec![1.0f32; grad_rows * 3]);
        add(&mut archive, "near", &[2], &[true, false]);
        add(&mut archive, "closest_observed", &[2], &[true, true]);
        archive.finish().expect("written");
    }

    #[test]
    fn what_is_there_is_read_and_the_rest_is_absent() {
        let folder = Folder::new();
        let empty = folder.load().expect("an empty folder is fine");
        assert!(empty.sdf.is_none() && empty.surface.is_none() && empty.novel.is_none());
        std::fs::create_dir(folder.0.path().join("novel")).expect("a folder");
        write_sdf(&folder, 2, 0.0);
        let truth = folder.load().expect("good");
        assert!(truth.novel.is_some_and(|novel| novel.ends_with("novel")));
        let sdf = truth.sdf.expect("there");
        assert_eq!(sdf.points[1], Vec3::X);
        assert_eq!((sdf.near[0], sdf.near[1], sdf.distances[1]), (true, false, 0.5));

        let mut archive = folder.archive("gt_surface.npz");
        add(&mut archive, "points", &[2, 3], &[0.0f32, 0.0, 0.0, 9.0, 9.0, 9.0]);
        add(&mut archive, "observed", &[2], &[true, false]);
        archive.finish().expect("written");
        assert!(folder.load().expect("good").surface.is_none(), "a surface needs its mesh");
        let mesh = TriangleMesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![],
            triangles: vec![[0, 1, 2]],
        };
        let mut file = File::create(folder.0.path().join("mesh.ply")).expect("a file");
        mesh.write_ply(&mut file).expect("written");
        let surface = folder.load().expect("good").surface.expect("there");
        assert_eq!(surface.observed_points, [Vec3::ZERO]);
        assert_eq!(surface.mesh, mesh);
    }

    #[test]
    fn broken_truth_is_an_error_that_names_the_array() {
        let folder = Folder::new();
        write_sdf(&folder, 3, 0.0);
        let error = folder.load().expect_err("3 gradients for 2 points").to_string();
        assert!(error.contains("[grad]") && error.contains("3 rows"), "{error}");
        write_sdf(&folder, 2, f32::NAN);
        let error = folder.load().expect_err("a point that is not finite").to_string();
        assert!(error.contains("row 0"), "{error}");
        std::fs::write(folder.0.path().join("gt_sdf.npz"), b"PK").expect("written");
        assert!(folder.load().is_err());
        assert!(Truth::load(&folder.0.path().join("absent")).is_err());
    }

    #[test]
    fn the_true_mesh_of_a_real_scene_judges_itself_perfect() {
        let Some(data) = std::env::var_os("ORENX_TEST_DATA") else {
            println!("skipped: the_true_mesh_of_a_real_scene_judges_itself_perfect");
            return;
        };
        let truth = Truth::load(&Path::new(&data).join("office")).expect("the office scene");
        let surface = truth.surface.expect("the office has a surface");
        let pool = crate::map::query_pool(2).expect("pool");
        let errors = crate::eval::surface::mesh_errors(&surface.mesh, &surface, &pool);
        assert!(errors.accuracy_m < 1e-6 && errors.completion_m < 1e-5, "{errors:?}");
        assert_eq!((errors.f_score_5cm, errors.f_score_2cm), (1.0, 1.0));
        assert_eq!(truth.sdf.expect("the office has distances").points.len(), 200_000);
    }
}
