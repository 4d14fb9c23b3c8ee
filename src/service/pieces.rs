//! The surface for those who draw it as it grows: pieces that changed since they were told, made by the
//! readers and kept, so that many pages cost what one does.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::tasks::{CHUNK, Task};
use super::terms::{Answered, Terms, check_within};
use super::{DEFAULT_MAP, Service};
use crate::error::{Error, Result};
use crate::map::{
    Detail, MapView, MeshFormat, MeshPart, PieceKey, PieceTable, WholeMesh, packed_piece,
    piece_size_m,
};

/// Between two looks at what changed.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);
/// Pieces that are made for one answer: it should come soon, and readers have other questions.
const MAX_MADE: usize = 24;
/// Pieces in an answer.
const MAX_PIECES: usize = 4096;
/// Bytes of an answer's pieces that a question may ask for; one piece always fits.
const BYTES: [usize; 2] = [64 << 10, 8 << 20];
/// Bytes of the pieces that are kept.
const KEPT_BYTES: usize = 64 << 20;
/// What nobody asked for in this time is forgotten, with the view that it holds on to.
const FORGET: Duration = Duration::from_secs(30);
/// Resolutions of a whole mesh, m.
const RESOLUTIONS_M: [f32; 2] = [0.001, 1.0];

/// Which pieces. Nothing is checked before [`Service::pieces`] sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PiecesQuestion {
    pub map_id: String,
    /// Whose changes are counted, as the last answer has it; 0 at first.
    pub generation: u64,
    /// The change up to which everything is known, as the last answer has it.
    pub since: u64,
    pub detail: Detail,
    /// About how many bytes the pieces may have.
    pub max_bytes: usize,
}

impl Default for PiecesQuestion {
    /// Everything of the default map.
    fn default() -> Self {
        Self {
            map_id: DEFAULT_MAP.into(),
            generation: 0,
            since: 0,
            detail: Detail::Medium,
            max_bytes: 1 << 20,
        }
    }
}

/// Some pieces.
#[derive(Debug, Clone, PartialEq)]
pub struct PiecesReply {
    /// Names the count of changes; another one counts anew.
    pub generation: u64,
    /// Whether everything that was told before is void.
    pub is_fresh: bool,
    /// What to ask for next.
    pub next: u64,
    /// Whether there is more to be told at once.
    pub has_more: bool,
    /// The newest epoch that was looked at.
    pub epoch: u64,
    /// Edge of a piece and distance between vertices, m.
    pub piece_m: f32,
    pub resolution_m: f32,
    /// Packed, the oldest change first.
    pub pieces: Vec<Arc<[u8]>>,
}

/// What is followed, and the pieces that are kept. One answer is made at a time: the next one finds
/// what this one made.
#[derive(Default)]
pub(super) struct Pieces(Arc<tokio::sync::Mutex<State>>);

#[derive(Default)]
struct State {
    maps: BTreeMap<String, Followed>,
    kept: Kept,
    /// Whether somebody looks after what is forgotten.
    is_tended: bool,
}

struct Followed {
    generation: u64,
    table: Arc<Mutex<PieceTable>>,
    looked: Option<Instant>,
    asked: Instant,
}

/// Of one map: its generation, how finely, and where.
type Place = (u64, Detail, PieceKey);

/// Packed pieces, by place, with their change and when they were asked for last.
#[derive(Default)]
struct Kept {
    pieces: BTreeMap<Place, (u64, u64, Arc<[u8]>)>,
    bytes: usize,
    clock: u64,
}

impl Kept {
    /// The piece, if it is as new as the change.
    fn get(&mut self, place: Place, change: u64) -> Option<Arc<[u8]>> {
        self.clock += 1;
        let (_, used, piece) = self.pieces.get_mut(&place).filter(|(kept, ..)| *kept >= change)?;
        *used = self.clock;
        Some(piece.clone())
    }

    fn put(&mut self, place: Place, change: u64, piece: Arc<[u8]>) {
        self.clock += 1;
        self.bytes += piece.len();
        if let Some((.., old)) = self.pieces.insert(place, (change, self.clock, piece)) {
            self.bytes -= old.len();
        }
        while self.bytes > KEPT_BYTES {
            let oldest = self.pieces.iter().min_by_key(|(_, (_, used, _))| *used);
            let Some(place) = oldest.map(|(place, _)| *place) else { break };
            self.bytes -= self.pieces.remove(&place).map_or(0, |(.., piece)| piece.len());
        }
    }

    fn forget(&mut self, generation: u64) {
        self.pieces.retain(|(of, ..), _| *of != generation);
        self.bytes = self.pieces.values().map(|(.., piece)| piece.len()).sum();
    }
}

impl State {
    /// What is followed of a view's map; from the start if it was not followed, or was another map.
    fn followed(&mut self, map_id: &str, view: &MapView) -> &mut Followed {
        let is_other = self.maps.get(map_id).is_some_and(|f| !locked(&f.table).is_of(view));
        if is_other && let Some(old) = self.maps.remove(map_id) {
            self.kept.forget(old.generation);
        }
        let followed = self.maps.entry(map_id.to_owned()).or_insert_with(|| Followed {
            generation: new_generation(),
            table: Arc::default(),
            looked: None,
            asked: Instant::now(),
        });
        followed.asked = Instant::now();
        followed
    }

    /// Forgets what nobody asks for any more; whether anything is left.
    fn tend(&mut self) -> bool {
        let is_old = |followed: &Followed| followed.asked.elapsed() >= FORGET;
        let old: Vec<u64> =
            self.maps.values().filter(|f| is_old(f)).map(|f| f.generation).collect();
        self.maps.retain(|_, followed| !is_old(followed));
        old.into_iter().for_each(|generation| self.kept.forget(generation));
        self.is_tended = !self.maps.is_empty();
        self.is_tended
    }
}

fn locked(table: &Mutex<PieceTable>) -> MutexGuard<'_, PieceTable> {
    table.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A number that no other count of changes has, of this process or of one before it.
fn new_generation() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |t| t.as_micros() as u64);
    // Within what JavaScript holds exactly until the year 2255.
    let raised = LAST.fetch_max(now, Relaxed);
    if raised < now { now } else { LAST.fetch_add(1, Relaxed) + 1 }
}

impl Service {
    /// Pieces of the newest view that changed after those that the question knows.
    pub async fn pieces(&self, question: PiecesQuestion) -> Result<PiecesReply> {
        let view = self.map(&question.map_id)?.published().view;
        let [least, most] = BYTES;
        if !(least..=most).contains(&question.max_bytes) {
            let problem = format!("{} must be within {least}..={most}", question.max_bytes);
            return Err(Error::invalid("max_bytes", problem));
        }
        let mut state = self.pieces.0.lock().await;
        let followed = state.followed(&question.map_id, &view);
        let (generation, table) = (followed.generation, followed.table.clone());
        if followed.looked.is_none_or(|at| at.elapsed() >= LOOK_INTERVAL) {
            self.readers.answer(LookTask { view: view.clone(), table: table.clone() }).await?;
            followed.looked = Some(Instant::now());
        }
        let is_fresh =
            question.generation != generation || question.since > locked(&table).changes();
        let since = if is_fresh { 0 } else { question.since };
        let (wanted, epoch) = {
            let table = locked(&table);
            let wanted: Vec<_> = table.since(since).take(MAX_PIECES + 1).collect();
            (wanted, table.epoch().unwrap_or_default())
        };
        let place = |key| (generation, question.detail, key);
        let (mut pieces, mut missing, mut bytes) = (Vec::new(), Vec::new(), 0);
        for (change, key) in wanted.iter().take(MAX_PIECES) {
            let kept = state.kept.get(place(*key), *change);
            bytes += kept.as_ref().map_or(0, |piece| piece.len());
            let is_full = bytes > question.max_bytes && !pieces.is_empty();
            if is_full || (kept.is_none() && missing.len() == MAX_MADE) {
                break;
            }
            if kept.is_none() {
                missing.push((pieces.len(), *key));
            }
            pieces.push(kept);
        }
        let keys = missing.iter().map(|(_, key)| *key).collect();
        let task = PiecesTask { view: view.clone(), keys, detail: question.detail };
        let (made, _) = self.readers.answer(task).await?;
        for ((at, key), piece) in missing.into_iter().zip(made) {
            state.kept.put(place(key), wanted[at].0, piece.clone());
            pieces[at] = Some(piece);
        }
        let mut pieces: Vec<Arc<[u8]>> = pieces.into_iter().flatten().collect();
        cut(&mut pieces, question.max_bytes);
        self.tend(&mut state);
        Ok(PiecesReply {
            generation,
            is_fresh,
            next: pieces.len().checked_sub(1).map_or(since, |last| wanted[last].0),
            has_more: pieces.len() < wanted.len(),
            epoch,
            piece_m: piece_size_m(view.config()),
            resolution_m: question.detail.resolution_m(view.config().r0_m),
            pieces,
        })
    }

    /// Sees to it that what nobody asks for is forgotten.
    fn tend(&self, state: &mut State) {
        if std::mem::replace(&mut state.is_tended, true) {
            return;
        }
        let all = Arc::downgrade(&self.pieces.0);
        tokio::spawn(async move {
            loop {
                tokio::time::sleep(FORGET / 3).await;
                let Some(all) = all.upgrade() else { return };
                if !all.lock().await.tend() {
                    return;
                }
            }
        });
    }

    /// The whole surface as a file with colours; `resolution_m` between vertices, half of the edge of
    /// a level-0 voxel where it is not given.
    pub async fn mesh_file(
        &self,
        map_id: &str,
        format: MeshFormat,
        resolution_m: Option<f32>,
    ) -> Result<Answered<Vec<u8>>> {
        let started = Instant::now();
        self.map(map_id)?;
        let [least, most] = RESOLUTIONS_M;
        resolution_m.map_or(Ok(()), |r| check_within("resolution", r, least, most))?;
        let terms = Terms { map_id: map_id.into(), ..Terms::default() };
        let task = |view: Arc<MapView>| {
            let usual = Detail::Medium.resolution_m(view.config().r0_m);
            let mesh = WholeMesh::new(view, resolution_m.unwrap_or(usual))?;
            Ok(MeshTask { mesh, format })
        };
        self.work(started, &terms, None, task).await
    }
}

/// Leaves the first pieces that fit.
fn cut(pieces: &mut Vec<Arc<[u8]>>, max_bytes: usize) {
    let mut bytes = 0;
    let fits = pieces.iter().take_while(|piece| {
        bytes += piece.len();
        bytes <= max_bytes
    });
    let fits = fits.count().max(1);
    pieces.truncate(fits);
}

/// A look at what changed.
struct LookTask {
    view: Arc<MapView>,
    table: Arc<Mutex<PieceTable>>,
}

impl Task for LookTask {
    type Part = ();
    type Answer = ();

    /// More than what is answered in place: every leaf near surfaces is looked at.
    fn size(&self) -> usize {
        CHUNK
    }

    fn chunks(&self) -> usize {
        1
    }

    fn part(&self, _chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<()> {
        locked(&self.table).follow(&self.view, Instant::now());
        Ok(())
    }

    fn whole(&self, _parts: Vec<()>) {}
}

/// Some pieces, one a chunk.
struct PiecesTask {
    view: Arc<MapView>,
    keys: Vec<PieceKey>,
    detail: Detail,
}

impl Task for PiecesTask {
    type Part = Option<Arc<[u8]>>;
    type Answer = Vec<Arc<[u8]>>;

    fn size(&self) -> usize {
        self.keys.len() * CHUNK
    }

    fn chunks(&self) -> usize {
        self.keys.len().max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<Self::Part> {
        let key = self.keys.get(chunk);
        let piece = key.map(|key| packed_piece(&self.view, *key, self.detail)).transpose()?;
        Ok(piece.map(Arc::from))
    }

    fn whole(&self, parts: Vec<Self::Part>) -> Vec<Arc<[u8]>> {
        parts.into_iter().flatten().collect()
    }
}

/// A whole mesh, a part a chunk.
struct MeshTask {
    mesh: WholeMesh,
    format: MeshFormat,
}

impl Task for MeshTask {
    type Part = Option<MeshPart>;
    type Answer = Vec<u8>;

    fn size(&self) -> usize {
        (self.mesh.parts() * CHUNK).max(CHUNK)
    }

    fn chunks(&self) -> usize {
        self.mesh.parts().max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<Self::Part> {
        (chunk < self.mesh.parts()).then(|| self.mesh.part(chunk)).transpose()
    }

    fn whole(&self, parts: Vec<Self::Part>) -> Vec<u8> {
        WholeMesh::file(parts.into_iter().flatten().collect(), self.format)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_piece_that_was_asked_for_longest_ago_gives_way() {
        let mut kept = Kept::default();
        let piece = |bytes: usize| Arc::<[u8]>::from(vec![0; bytes]);
        let place = |x: i32| (7, Detail::Fine, [x, 0, 0]);
        (0..4).for_each(|x| kept.put(place(x), 1, piece(KEPT_BYTES / 4)));
        assert!(kept.get(place(0), 1).is_some() && kept.get(place(1), 2).is_none());
        kept.put(place(4), 1, piece(8));
        assert!(kept.get(place(0), 1).is_some() && kept.get(place(1), 1).is_none());
        kept.put(place(4), 2, piece(16));
        assert_eq!(kept.bytes, KEPT_BYTES / 4 * 3 + 16);
        kept.forget(7);
        assert_eq!((kept.bytes, kept.pieces.len()), (0, 0));
    }

    #[test]
    fn generations_differ() {
        let all: std::collections::BTreeSet<u64> = (0..100).map(|_| new_generation()).collect();
        assert_eq!(all.len(), 100);
    }
}
