//! Language in a map: a dictionary that learns from the features of frames, and codes at the
//! vertices of a band near surfaces (paper, memory compression; algorithms.md §9).

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use super::codes::Codes;
use super::dictionary::{Dictionary, DictionarySettings, DictionaryState};
use super::features::UnitFeatures;
use super::kept::KeptCodes;
use crate::config::{DictionaryKind, LanguageConfig, MapConfig};
use crate::error::{Error, Fault, Result};
use crate::frame::{Contract, FeatureImage, Frame, NO_FEATURE, pixel_beside};
use crate::numpy::ArrayReader;
use crate::octree::{Band, BandScale, Cell, NO_BLOCK};

/// Frames before the first atom. What a single frame shows can be asked for; a direction that it
/// took too early costs a place among the atoms and no more.
const FIRST_FRAMES: u64 = 1;

/// Patches of a grid around a pixel, and the share of each in its feature.
type Mix = [(usize, f32); 4];

/// What a map knows of language.
#[derive(Debug)]
pub struct LanguageField {
    config: LanguageConfig,
    pub band: Band,
    /// Atoms of a file, until the first features come.
    given: Option<Dictionary>,
    learned: Option<Learned>,
    /// The frame that changed a block last.
    touched: Vec<u32>,
    /// Blocks that changed since [`LanguageField::take_changed`].
    changed: Vec<u32>,
}

/// What the first features begin.
#[derive(Debug)]
struct Learned {
    contract: Contract,
    dictionary: Dictionary,
    /// The atoms as they were published last.
    published: Arc<Dictionary>,
    codes: Codes,
}

impl Learned {
    fn new(contract: Contract, dictionary: Dictionary) -> Self {
        let published = Arc::new(dictionary.atoms());
        let codes = Codes::new(dictionary.capacity());
        Self { contract, dictionary, published, codes }
    }
}

/// Language as a checkpoint holds it.
#[derive(Debug)]
pub struct LanguageState<'a> {
    /// None before the first features.
    pub learned: Option<(Contract, DictionaryState)>,
    /// The cells of the blocks.
    pub cells: Cow<'a, [Cell]>,
    /// By vertex.
    pub weights: Cow<'a, [f32]>,
    /// By vertex, as many numbers as there are atoms.
    pub codes: Vec<f32>,
}

impl LanguageField {
    /// How the band divides space, if a map has language.
    pub fn scale(config: &MapConfig) -> Option<BandScale> {
        let log2 = config.language.log2_spacing;
        let scale = BandScale {
            cell_m: config.r0_m * f32::from(log2.max(0)).exp2(),
            log2_side: (-log2).max(0) as u8,
        };
        config.has("language").then_some(scale)
    }

    /// What a block takes in a field and in views, bytes, at worst: with all atoms.
    pub fn block_bytes(config: &MapConfig) -> (usize, usize) {
        let Some(scale) = Self::scale(config) else { return (1, 1) };
        let (language, atoms) = (&config.language, most_atoms(&config.language));
        let kept = KeptCodes::bytes_of(language.codes, language.terms as usize, atoms);
        (
            Band::BLOCK_BYTES + 4 + Codes::bytes_of(scale.vertices(), atoms),
            size_of::<Cell>() + 32 + scale.vertices() * kept,
        )
    }

    /// Nothing seen yet; without the atoms of a file.
    pub fn new(scale: BandScale, config: &LanguageConfig) -> Self {
        Self {
            config: config.clone(),
            band: Band::new(scale),
            given: None,
            learned: None,
            touched: Vec::new(),
            changed: Vec::new(),
        }
    }

    /// Bounds the blocks from now on; what there is stays. As many codes as there may be at all fit in.
    pub fn limit(&mut self, blocks: usize) {
        let most = Codes::max_rows(most_atoms(&self.config)) / self.band.scale.vertices();
        self.band.limit(blocks.min(most));
    }

    /// Reads the atoms that the settings name, if they do and if it is not done yet.
    pub fn with_given(mut self) -> Result<Self> {
        if let (DictionaryKind::Given(path), None) = (&self.config.dictionary, &self.learned) {
            self.given = Some(read_atoms(path)?);
        }
        Ok(self)
    }

    /// What features and texts must come from; `None` before the first features.
    pub fn contract(&self) -> Option<&Contract> {
        self.learned.as_ref().map(|learned| &learned.contract)
    }

    /// The atoms to publish.
    pub fn dictionary(&self) -> Option<Arc<Dictionary>> {
        self.learned.as_ref().map(|learned| learned.published.clone())
    }

    /// The code of a vertex, as far as there are atoms; `None` where no frame saw it.
    pub fn code(&self, row: usize) -> Option<&[f32]> {
        let Learned { dictionary, codes, .. } = self.learned.as_ref()?;
        let seen = row < codes.rows() && codes.weight(row) > 0.0;
        seen.then(|| &codes.code(row)[..dictionary.len()])
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let learned = self.learned.as_ref().map_or(0, |learned| {
            let Learned { dictionary, published, codes, .. } = learned;
            let capacity = dictionary.capacity();
            dictionary.bytes() + published.bytes() + Codes::bytes_of(codes.rows(), capacity)
        });
        (learned + self.band.blocks() * (Band::BLOCK_BYTES + 4)) as u64
    }

    /// Blocks of which vertices or neighbours changed since the last call, sorted.
    pub fn take_changed(&mut self) -> Vec<u32> {
        let mut changed = std::mem::take(&mut self.changed);
        changed.extend(self.band.take_linked());
        changed.sort_unstable();
        changed.dedup();
        changed
    }

    /// Refuses features that cannot be compared with those of the map.
    pub fn admit(&self, features: &FeatureImage) -> Result<()> {
        let contract = &features.contract;
        match (&self.learned, &self.given) {
            (Some(learned), _) => match learned.contract.mismatch(contract) {
                Some(problem) => Err(Error::frame(Fault::Encoder, "features.encoder_id", problem)),
                None => Ok(()),
            },
            (None, Some(given)) if given.dimension() != contract.dimension => {
                let atoms = given.dimension();
                let problem = format!("{} numbers, but atoms have {atoms}", contract.dimension);
                Err(Error::invalid("features.dimension", problem))
            }
            (None, Some(_)) => Ok(()),
            (None, None) => self.begin(contract.dimension).map(drop),
        }
    }

    fn begin(&self, dimension: usize) -> Result<Dictionary> {
        match (&self.config.dictionary, &self.given) {
            (_, Some(given)) => Ok(given.clone()),
            (DictionaryKind::Full, None) => Dictionary::identity(dimension),
            (DictionaryKind::Online | DictionaryKind::Given(_), None) => {
                Dictionary::new(dimension, self.learns_by())
            }
        }
    }

    fn learns_by(&self) -> DictionarySettings {
        DictionarySettings {
            decay: self.config.decay,
            threshold: self.config.threshold,
            capacity: self.config.capacity as usize,
            first_frames: FIRST_FRAMES,
        }
    }

    /// Takes the features of a frame in, which must have been admitted; `number` counts the frames
    /// from 1.
    pub fn integrate(&mut self, frame: &Frame, number: u32) -> Result<()> {
        let Some(image) = frame.features.as_ref().filter(|image| !image.is_empty()) else {
            return Ok(());
        };
        let mut learned = match self.learned.take() {
            Some(learned) => learned,
            None => {
                let dictionary = self.begin(image.contract.dimension)?;
                self.given = None;
                Learned::new(image.contract.clone(), dictionary)
            }
        };
        let took = self.take(frame, image, &mut learned, number);
        self.learned = Some(learned);
        took
    }

    fn take(
        &mut self,
        frame: &Frame,
        image: &FeatureImage,
        learned: &mut Learned,
        number: u32,
    ) -> Result<()> {
        let dimension = image.contract.dimension;
        let features = UnitFeatures::new(image.features.clone(), dimension)?;
        let Learned { dictionary, published, codes, .. } = learned;
        if dictionary.learns() {
            let step = features.len().div_ceil(self.config.samples as usize);
            let some = features.iter().skip(number as usize % step).step_by(step);
            let some: Vec<f32> = some.flatten().copied().collect();
            if dictionary.learn(&UnitFeatures::new(some, dimension)?)? > 0 {
                *published = Arc::new(dictionary.atoms());
            }
        }
        if dictionary.is_empty() {
            return Ok(());
        }
        let seen = dictionary.encode(&features)?;
        self.observe(frame, image, &seen, dictionary.len(), codes, number)
    }

    /// Takes the codes of a frame's features to the vertices around what they show.
    fn observe(
        &mut self,
        frame: &Frame,
        image: &FeatureImage,
        seen: &[f32],
        atoms: usize,
        codes: &mut Codes,
        number: u32,
    ) -> Result<()> {
        let (k, stride) = (&frame.intrinsics, self.config.stride);
        let of = |feature: usize| &seen[feature * atoms..(feature + 1) * atoms];
        let own = (image.width, image.height);
        let mut mixed = vec![0.0; atoms];
        for v in (stride / 2..k.height).step_by(stride as usize) {
            for u in (stride / 2..k.width).step_by(stride as usize) {
                let z = frame.depth.at(u, v);
                if z <= 0.0 || frame.depth.is_edge(u, v) {
                    continue;
                }
                let code = match &image.index {
                    Some(index) => match index[pixel_beside((u, v), (k.width, k.height), own)] {
                        NO_FEATURE => continue,
                        feature => of(usize::from(feature)),
                    },
                    None => {
                        mixed.fill(0.0);
                        for (patch, share) in patches_around(image, u, v, frame) {
                            let parts = mixed.iter_mut().zip(of(patch));
                            parts.for_each(|(to, x)| *to += share * x);
                        }
                        &mixed[..]
                    }
                };
                let place = self.band.scale.place(frame.world_point(u, v, z));
                let Some(block) = self.band.hold(&place) else { continue };
                codes.resize(self.band.rows())?;
                let rows = self.band.scale.vertices_around(&place, self.band.uppers(block));
                codes.observe(&rows, &place.weights(), code);
                self.mark(block, number);
            }
        }
        codes.resize(self.band.rows())
    }

    /// Notes that the vertices around a place in `block` change in frame `number`.
    fn mark(&mut self, block: u32, number: u32) {
        self.touched.resize(self.band.blocks(), 0);
        for upper in *self.band.uppers(block) {
            if upper != NO_BLOCK
                && std::mem::replace(&mut self.touched[upper as usize], number) != number
            {
                self.changed.push(upper);
            }
        }
    }

    /// Forgets the codes of vertices, given block by block.
    pub fn forget(&mut self, lost: &[(u32, Vec<u32>)]) {
        let Some(learned) = &mut self.learned else { return };
        for (block, rows) in lost {
            rows.iter().for_each(|row| learned.codes.forget(*row as usize));
            self.changed.push(*block);
        }
    }

    /// Everything that [`LanguageField::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> LanguageState<'_> {
        let cells = Cow::Borrowed(self.band.cells());
        match &self.learned {
            None => LanguageState {
                learned: None,
                cells,
                weights: Cow::Borrowed(&[]),
                codes: Vec::new(),
            },
            Some(Learned { contract, dictionary, codes, .. }) => LanguageState {
                learned: Some((contract.clone(), dictionary.state())),
                cells,
                weights: Cow::Borrowed(codes.weights()),
                codes: codes.values(dictionary.len()),
            },
        }
    }

    /// Takes up a stored state; every block counts as changed. `self` brings the settings.
    pub fn with_state(mut self, state: LanguageState<'_>) -> Result<Self> {
        let damaged = || Error::corrupt("language", "blocks and codes do not fit together");
        self.band = Band::with_cells(self.band.scale, &state.cells).ok_or_else(damaged)?;
        self.touched = vec![0; self.band.blocks()];
        let Some((contract, stored)) = state.learned else {
            return if state.cells.is_empty() { Ok(self) } else { Err(damaged()) };
        };
        if contract.check("contract").is_err() || contract.dimension != stored.dimension {
            return Err(damaged());
        }
        let dictionary = Dictionary::with_state(&stored, self.learns_by())?;
        let (width, weights) = (dictionary.len(), state.weights.into_owned());
        if weights.len() != self.band.rows() {
            return Err(damaged());
        }
        let codes = Codes::with_values(dictionary.capacity(), weights, &state.codes, width)?;
        self.learned = Some(Learned { codes, ..Learned::new(contract, dictionary) });
        Ok(self)
    }
}

/// How many atoms there may be before the first features say how long they are.
fn most_atoms(config: &LanguageConfig) -> usize {
    match config.dictionary {
        DictionaryKind::Online => config.capacity as usize,
        DictionaryKind::Full | DictionaryKind::Given(_) => super::MAX_CAPACITY,
    }
}

/// The four patches whose centres are around a pixel of the depth image, with bilinear shares.
fn patches_around(image: &FeatureImage, u: u32, v: u32, frame: &Frame) -> Mix {
    let k = &frame.intrinsics;
    let along = |at: u32, own: u32, other: u32| {
        let x = (at as f32 + 0.5) * own as f32 / other as f32 - 0.5;
        let x = x.clamp(0.0, own as f32 - 1.0);
        let low = (x as u32).min(own - 1);
        (low as usize, (low + 1).min(own - 1) as usize, x - low as f32)
    };
    let (left, right, x) = along(u, image.width, k.width);
    let (top, bottom, y) = along(v, image.height, k.height);
    let at = |row: usize, column: usize| row * image.width as usize + column;
    [
        (at(top, left), (1.0 - y) * (1.0 - x)),
        (at(top, right), (1.0 - y) * x),
        (at(bottom, left), y * (1.0 - x)),
        (at(bottom, right), y * x),
    ]
}

/// Atoms as the rows of a file.
fn read_atoms(path: &Path) -> Result<Dictionary> {
    let name = path.display().to_string();
    let file = std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
    let reader = ArrayReader::new(std::io::BufReader::new(file), name.clone())?;
    let shape = reader.shape().to_vec();
    let [rows, dimension] = shape[..] else {
        return Err(Error::invalid(name, format!("must be (atoms, numbers), not {shape:?}")));
    };
    let most = super::MAX_CAPACITY * crate::frame::MAX_DIMENSION;
    if rows.saturating_mul(dimension) > most {
        return Err(Error::invalid(name, format!("{shape:?} is more than {most} numbers")));
    }
    Dictionary::fixed(&reader.into_values::<f32>()?, dimension)
}
