//! `orenx query`: one point on the terminal, or a file of points to a file of answers.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use glam::Vec3;
use rayon::ThreadPool;
use tokio::runtime::Runtime;

use super::credentials::CredentialArgs;
use super::numbers::parse_point;
use super::open::{MapName, asking_runtime, is_url, open_view};
use crate::client::Questioner;
use crate::error::{Error, Result};
use crate::map::{Fields, MapView, PointAnswers, State, query_parallel, query_pool};
use crate::numpy::{ArchiveWriter, ArrayReader, Element, write_values};
use crate::service::PointsQuestion;
use crate::storage::{folder_of, write_file};

/// Points in memory at a time, whatever the size of the file.
const PIECE_POINTS: usize = 1 << 17;

/// Ask a map about points: signed distance, gradient, occupancy, state, color
#[derive(Debug, Args)]
pub struct QueryArgs {
    /// Map file, or the URL of a server, as in http://127.0.0.1:7611 or grpc://127.0.0.1:7610
    pub map: String,
    /// A point in world metres; may be repeated
    #[arg(
        long = "point",
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        value_parser = parse_point,
        required_unless_present = "points_file",
        conflicts_with = "points_file"
    )]
    pub points: Vec<Vec3>,
    /// An .npy file of points, (N, 3) f32 or f64, world metres
    #[arg(long = "points", value_name = "FILE.npy", id = "points_file", requires = "out")]
    pub points_file: Option<PathBuf>,
    /// Where the answers go: arrays sdf, gradient, occupancy, state, color
    #[arg(long, value_name = "FILE.npz", requires = "points_file")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    name: MapName,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl QueryArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let source = Source::open(&self)?;
        match (&self.points_file, &self.out) {
            (Some(points), Some(out)) => answer_file(&source, points, out)?,
            _ => {
                let answers = source.answer(&self.points)?;
                for (i, point) in self.points.iter().enumerate() {
                    println!("{}", describe(*point, &answers, i));
                }
            }
        }
        Ok(())
    }
}

/// Who answers.
enum Source {
    View { view: Arc<MapView>, pool: ThreadPool },
    Server { client: Questioner, runtime: Runtime, map_id: String },
}

impl Source {
    fn open(QueryArgs { map, name, credentials, .. }: &QueryArgs) -> Result<Self> {
        let map_id = name.of(map)?;
        if is_url(map) {
            let credentials = credentials.read()?;
            let runtime = asking_runtime()?;
            let client = runtime.block_on(Questioner::connect_with(map, &credentials))?;
            return Ok(Self::Server { client, runtime, map_id });
        }
        Ok(Self::View { view: open_view(Path::new(map))?, pool: query_pool(0)? })
    }

    fn answer(&self, points: &[Vec3]) -> Result<PointAnswers> {
        match self {
            Self::View { view, pool } => {
                let query = |points: &[Vec3], fields| view.query(points, fields);
                Ok(query_parallel(&query, points, Fields::ALL, pool))
            }
            // Each piece is answered by the newest epoch.
            Self::Server { client, runtime, map_id } => {
                let map_id = map_id.clone();
                let question = PointsQuestion { map_id, ..PointsQuestion::new(points.to_vec()) };
                Ok(runtime.block_on(client.ask(&question))?.answers)
            }
        }
    }
}

/// One line about one point; numbers that nobody knows are left out.
fn describe(point: Vec3, answers: &PointAnswers, i: usize) -> String {
    let state = match answers.state[i] {
        s if s == State::Free as u8 => "free",
        s if s == State::Occupied as u8 => "occupied",
        _ => "unknown",
    };
    let mut line = format!("point {} {} {}  state {state}", point.x, point.y, point.z);
    let distance = answers.distance[i];
    if distance.is_finite() {
        line += &format!("  distance {distance:.4} m");
    }
    let gradient = answers.gradient[i];
    if gradient.is_finite() {
        line += &format!("  gradient {:.3} {:.3} {:.3}", gradient.x, gradient.y, gradient.z);
    }
    if let Some(occupancy) = answers.occupancy.get(i).filter(|p| p.is_finite()) {
        line += &format!("  occupancy {occupancy:.3}");
    }
    if let Some(color) = answers.color.get(i).filter(|c| c.is_finite()) {
        line += &format!("  color {:.3} {:.3} {:.3}", color.x, color.y, color.z);
    }
    line
}

fn answer_file(source: &Source, points: &Path, out: &Path) -> Result<()> {
    let file = File::open(points).map_err(|e| Error::io(points, e))?;
    let reader = ArrayReader::new(BufReader::new(file), points.display().to_string())?;
    let columns = Columns::answer(reader, folder_of(out), |points| source.answer(points))?;
    let (rows, known) = (columns.rows, columns.known);
    write_file(out, |file| columns.write(file))?;
    println!("{}: {rows} points, {known} known", out.display());
    Ok(())
}

/// Answers on disk, column by column, because an archive holds one array after the other and a
/// large query need not fit into memory.
struct Columns {
    rows: usize,
    /// Rows whose state is known.
    known: usize,
    sdf: Spool,
    gradient: Spool,
    occupancy: Spool,
    /// Rows with an occupancy: none where the map has no such column.
    occupancies: usize,
    state: Spool,
    color: Spool,
    /// Rows with a color, likewise.
    colors: usize,
}

impl Columns {
    /// Answers an (N, 3) array of points piece by piece; `folder` takes the unnamed files.
    fn answer<R: Read>(
        mut reader: ArrayReader<R>,
        folder: &Path,
        mut answer: impl FnMut(&[Vec3]) -> Result<PointAnswers>,
    ) -> Result<Self> {
        let [rows, 3] = *reader.shape() else {
            return Err(Error::invalid(
                "points",
                format!("has shape {:?}, but (N, 3) is needed", reader.shape()),
            ));
        };
        let spool = || Spool::new(folder);
        let mut columns = Self {
            rows,
            known: 0,
            sdf: spool()?,
            gradient: spool()?,
            occupancy: spool()?,
            occupancies: 0,
            state: spool()?,
            color: spool()?,
            colors: 0,
        };
        let mut left = rows;
        while left > 0 {
            let flat: Vec<f32> = reader.next_values(PIECE_POINTS.min(left) * 3)?;
            let points: Vec<Vec3> = flat.chunks_exact(3).map(Vec3::from_slice).collect();
            left -= points.len();
            let answers = answer(&points)?;
            columns.append(&answers).map_err(|e| Error::io(folder, e))?;
        }
        reader.finish()?;
        Ok(columns)
    }

    fn append(&mut self, answers: &PointAnswers) -> std::io::Result<()> {
        write_values(&mut self.sdf.0, &answers.distance)?;
        let gradient: &[f32] = bytemuck::cast_slice(&answers.gradient);
        write_values(&mut self.gradient.0, gradient)?;
        write_values(&mut self.occupancy.0, &answers.occupancy)?;
        self.occupancies += answers.occupancy.len();
        write_values(&mut self.state.0, &answers.state)?;
        let is_known = |state: &&u8| **state != State::Unknown as u8;
        self.known += answers.state.iter().filter(is_known).count();
        let color: &[f32] = bytemuck::cast_slice(&answers.color);
        self.colors += answers.color.len();
        write_values(&mut self.color.0, color)
    }

    /// Writes the archive that `numpy.load` reads.
    fn write(self, out: &mut (impl Write + Seek)) -> std::io::Result<()> {
        let n = self.rows;
        let mut archive = ArchiveWriter::new(out);
        self.sdf.copy(archive.start("sdf", Element::F32, &[n])?)?;
        self.gradient.copy(archive.start("gradient", Element::F32, &[n, 3])?)?;
        if self.occupancies == n {
            self.occupancy.copy(archive.start("occupancy", Element::F32, &[n])?)?;
        }
        self.state.copy(archive.start("state", Element::U8, &[n])?)?;
        if self.colors == n {
            self.color.copy(archive.start("color", Element::F32, &[n, 3])?)?;
        }
        archive.finish().map(drop)
    }
}

/// An unnamed file that vanishes with its handle.
struct Spool(BufWriter<File>);

impl Spool {
    fn new(folder: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(|e| Error::io(folder, e))?;
        Ok(Self(BufWriter::new(file)))
    }

    fn copy(self, out: &mut impl Write) -> std::io::Result<()> {
        let mut file = self.0.into_inner()?;
        file.rewind()?;
        std::io::copy(&mut file, out).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::numpy::{Archive, write_array};

    /// Knows everything with finite coordinates: the distance is x.
    fn answer(points: &[Vec3]) -> Result<PointAnswers> {
        let known = |p: &Vec3| p.is_finite();
        let number = |p: &Vec3, value: f32| if known(p) { value } else { f32::NAN };
        Ok(PointAnswers {
            distance: points.iter().map(|p| number(p, p.x)).collect(),
            gradient: points.iter().map(|p| Vec3::new(number(p, 1.0), 0.0, 0.0)).collect(),
            occupancy: points.iter().map(|p| number(p, 0.25)).collect(),
            state: points.iter().map(|p| u8::from(known(p))).collect(),
            color: points.iter().map(|p| Vec3::new(number(p, 0.5), 0.0, 1.0)).collect(),
            ..PointAnswers::default()
        })
    }

    fn run(shape: &[usize], points: &[f32]) -> Result<Archive<Cursor<Vec<u8>>>> {
        let mut bytes = Vec::new();
        write_array(&mut bytes, shape, points).expect("memory");
        let reader = ArrayReader::new(Cursor::new(bytes), "p.npy")?;
        let folder = tempfile::tempdir().expect("a folder");
        let columns = Columns::answer(reader, folder.path(), answer)?;
        let mut out = Cursor::new(Vec::new());
        columns.write(&mut out).expect("memory");
        out.set_position(0);
        Archive::new(out, "q.npz")
    }

    #[test]
    fn points_and_not_a_number_go_in_and_columns_come_out() {
        let mut out =
            run(&[3, 3], &[0.5, 0.0, 0.0, f32::NAN, 0.0, 0.0, -2.0, 1.0, 1.0]).expect("good input");
        let sdf: Vec<f32> = out.rows("sdf", 1).expect("sdf");
        assert!(sdf[0] == 0.5 && sdf[1].is_nan() && sdf[2] == -2.0, "{sdf:?}");
        assert_eq!(out.rows::<u8>("state", 1).expect("state"), [1, 0, 1]);
        assert_eq!(out.rows::<f32>("gradient", 3).expect("gradient").len(), 9);
        assert_eq!(out.rows::<f32>("occupancy", 1).expect("occupancy")[2], 0.25);
        let color: Vec<f32> = out.rows("color", 3).expect("color");
        assert!(color[..3] == [0.5, 0.0, 1.0] && color[3].is_nan(), "{color:?}");
    }

    #[test]
    fn more_points_than_one_piece_keep_their_order() {
        let n = PIECE_POINTS + 77;
        let points: Vec<f32> = (0..n).flat_map(|i| [i as f32, 0.0, 0.0]).collect();
        let sdf: Vec<f32> = run(&[n, 3], &points).expect("good").rows("sdf", 1).expect("sdf");
        assert_eq!(sdf.len(), n);
        assert!(sdf.iter().enumerate().all(|(i, &d)| d == i as f32));
    }

    #[test]
    fn no_points_give_empty_columns_and_wrong_shapes_an_error() {
        let mut out = run(&[0, 3], &[]).expect("an empty file is a file");
        assert!(out.rows::<f32>("sdf", 1).expect("sdf").is_empty());
        for shape in [vec![6], vec![3, 2], vec![1, 2, 3]] {
            let error = run(&shape, &[0.0; 6]).err().expect("not (N, 3)").to_string();
            assert!(error.contains("(N, 3)"), "{error}");
        }
    }

    #[test]
    fn a_line_names_what_is_known() {
        let points = [Vec3::new(0.5, 1.0, 0.0), Vec3::NAN];
        let answers = answer(&points).expect("answers");
        assert_eq!(
            describe(points[0], &answers, 0),
            "point 0.5 1 0  state free  distance 0.5000 m  gradient 1.000 0.000 0.000  \
             occupancy 0.250  color 0.500 0.000 1.000"
        );
        assert!(describe(points[1], &answers, 1).ends_with("state unknown"));
    }
}
