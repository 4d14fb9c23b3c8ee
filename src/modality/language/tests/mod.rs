//! What must hold of dictionary, codes and scores together.

mod classes;

use proptest::prelude::*;

use super::eigen::symmetric;
use super::features::norm;
use super::*;
use crate::config::CodeForm;
use crate::geometry::random::{normal, pcg4d};

/// Standard normal numbers; `stream` keeps those of different purposes apart.
fn normals(seed: u32, stream: u32, count: usize) -> Vec<f32> {
    let number = |i| {
        let [a, b, ..] = pcg4d([seed, stream, i, 77]);
        normal(a, b)
    };
    (0..count as u32).map(number).collect()
}

/// Frames of features near a subspace of some rank, whose directions have falling shares.
#[derive(Debug, Clone)]
struct Sequence {
    dimension: usize,
    samples: Vec<usize>,
    rank: usize,
    noise: f32,
    seed: u32,
}

impl Sequence {
    fn frame(&self, frame: usize) -> UnitFeatures {
        let n = self.dimension;
        let basis: Vec<Vec<f32>> =
            (0..self.rank as u32).map(|k| normals(self.seed, k, n)).collect();
        let mut values = Vec::new();
        for sample in 0..self.samples[frame] {
            let stream = 1000 + 1000 * frame as u32 + sample as u32;
            let mut feature = normals(self.seed ^ 1, stream, n);
            feature.iter_mut().for_each(|x| *x *= self.noise);
            for (k, z) in normals(self.seed ^ 2, stream, self.rank).into_iter().enumerate() {
                let share = z / (1.0 + k as f32) + f32::from(u8::from(k == 0));
                feature.iter_mut().zip(&basis[k]).for_each(|(x, b)| *x += share * b);
            }
            values.extend(feature);
        }
        UnitFeatures::new(values, n).unwrap()
    }
}

fn sequences() -> impl Strategy<Value = Sequence> {
    let samples = prop::collection::vec(0usize..90, 1..8);
    (1usize..150, samples, 0usize..12, prop::sample::select(vec![0.0, 0.05, 1.0]), any::<u32>())
        .prop_map(|(dimension, samples, rank, noise, seed)| Sequence {
            dimension,
            samples,
            rank,
            noise,
            seed,
        })
}

fn settings() -> impl Strategy<Value = DictionarySettings> {
    (1usize..50, prop::sample::select(vec![0.0005, 0.002, 0.05]), 0.5f32..0.99, 0u64..4).prop_map(
        |(capacity, threshold, decay, first_frames)| DictionarySettings {
            decay,
            threshold,
            capacity,
            first_frames,
        },
    )
}

/// How far DᵀD is from I.
fn skew(dictionary: &Dictionary) -> f64 {
    let mut worst = 0.0f64;
    for i in 0..dictionary.len() {
        for j in 0..=i {
            let (a, b) = (dictionary.atom(i).unwrap(), dictionary.atom(j).unwrap());
            let product: f64 = a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            worst = worst.max((product - f64::from(u8::from(i == j))).abs());
        }
    }
    worst
}

/// R of a state, row by row.
fn scatter(state: &DictionaryState) -> Vec<Vec<f64>> {
    let n = state.dimension;
    let at =
        |i: usize, j: usize| f64::from(state.scatter[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)]);
    (0..n).map(|i| (0..n).map(|j| at(i, j)).collect()).collect()
}

/// xᵀRx.
fn form(r: &[Vec<f64>], x: &[f32]) -> f64 {
    let image = |row: &Vec<f64>| row.iter().zip(x).map(|(r, x)| r * f64::from(*x)).sum::<f64>();
    r.iter().zip(x).map(|(row, x)| image(row) * f64::from(*x)).sum()
}

/// The largest eigenvalue, by plain power iteration, which never exceeds it.
fn largest(r: &[Vec<f64>]) -> f64 {
    let mut u: Vec<f64> = normals(5, 5, r.len()).into_iter().map(f64::from).collect();
    let mut value = 0.0;
    for _ in 0..60 {
        let v: Vec<f64> =
            r.iter().map(|row| row.iter().zip(&u).map(|(a, b)| a * b).sum()).collect();
        value = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if value == 0.0 {
            return 0.0;
        }
        u = v.into_iter().map(|x| x / value).collect();
    }
    value
}

fn cosine(a: &[f32], b: &[f32]) -> f64 {
    let product: f64 = a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
    product / (norm(a) * norm(b))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn atoms_stay_orthonormal_are_only_appended_and_leave_less_than_the_threshold(
        sequence in sequences(), settings in settings()
    ) {
        let mut dictionary = Dictionary::new(sequence.dimension, settings).unwrap();
        let mut before = Vec::new();
        let mut all = 0.0;
        for frame in 0..sequence.samples.len() {
            let features = sequence.frame(frame);
            let new = dictionary.learn(&features).unwrap();
            let state = dictionary.state();
            prop_assert!(skew(&dictionary) < 1e-5, "{}", skew(&dictionary));
            prop_assert_eq!(&state.atoms[..before.len()], &before[..]);
            prop_assert_eq!(state.atoms.len(), before.len() + new * sequence.dimension);
            prop_assert!(dictionary.len() <= settings.capacity.min(sequence.dimension));
            before = state.atoms.clone();

            let squares: f64 = features.iter().map(|v| norm(v).powi(2)).sum();
            all = all * f64::from(settings.decay) + squares;
            prop_assert!((state.energy - all).abs() <= 1e-6 * all);
            let r = scatter(&state);
            let trace: f64 = (0..r.len()).map(|i| r[i][i]).sum();
            prop_assert!(trace <= state.energy * 1.0001 && trace >= -1e-6 * state.energy);
            for probe in 0..4 {
                let x = normals(probe, 9, r.len());
                let energy = form(&r, &x) / norm(&x).powi(2);
                prop_assert!(energy >= -1e-6 * state.energy, "{energy} of {}", state.energy);
            }
            let is_full = dictionary.len() == settings.capacity.min(sequence.dimension);
            if !is_full && frame as u64 + 1 >= settings.first_frames {
                let limit = f64::from(settings.threshold) * state.energy;
                prop_assert!(largest(&r) <= 1.02 * limit + 1e-6 * state.energy,
                    "{} > {limit}", largest(&r));
            }
        }
    }

    #[test]
    fn a_stored_dictionary_goes_on_as_if_it_had_not_stopped(
        sequence in sequences(), settings in settings(), stop in 0usize..8
    ) {
        let mut whole = Dictionary::new(sequence.dimension, settings).unwrap();
        let mut stopped = whole.clone();
        for frame in 0..sequence.samples.len() {
            whole.learn(&sequence.frame(frame)).unwrap();
            stopped.learn(&sequence.frame(frame)).unwrap();
            if frame == stop {
                stopped = Dictionary::with_state(&stopped.state(), settings).unwrap();
            }
        }
        prop_assert_eq!(whole.state(), stopped.state());
    }

    #[test]
    fn codes_outlive_growth_and_errors_fall(sequence in sequences(), settings in settings()) {
        let features = sequence.frame(0);
        let mut dictionary = Dictionary::new(sequence.dimension, settings).unwrap();
        let mut old: Option<(Vec<f32>, usize)> = None;
        let error = |dictionary: &Dictionary, codes: &[f32], count: usize| -> f64 {
            let pairs = features.iter().enumerate().map(|(i, v)| {
                let decoded = dictionary.decode(&codes[i * count..(i + 1) * count]);
                let rest: Vec<f32> = decoded.iter().zip(v).map(|(a, b)| a - b).collect();
                norm(&rest).powi(2)
            });
            pairs.sum()
        };
        for frame in 0..sequence.samples.len() {
            dictionary.learn(&sequence.frame(frame)).unwrap();
            let (codes, count) = (dictionary.encode(&features).unwrap(), dictionary.len());
            if let Some((old, before)) = &old {
                for (a, b) in old.chunks(*before.max(&1)).zip(codes.chunks(count.max(1))) {
                    prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6));
                }
                let (then, now) =
                    (error(&dictionary, old, *before), error(&dictionary, &codes, count));
                prop_assert!(now <= then + 1e-5, "{now} > {then}");
            }
            old = Some((codes, count));
        }
    }

    #[test]
    fn scores_of_codes_are_those_of_decoded_features(
        sequence in sequences(), settings in settings(), seed in any::<u32>()
    ) {
        let mut dictionary = Dictionary::new(sequence.dimension, settings).unwrap();
        for frame in 0..sequence.samples.len() {
            dictionary.learn(&sequence.frame(frame)).unwrap();
        }
        let text = normals(seed, 3, sequence.dimension);
        let query = dictionary.query(&text).unwrap();
        let features = sequence.frame(0);
        let codes = dictionary.encode(&features).unwrap();
        for code in codes.chunks(dictionary.len().max(1)) {
            let expected = cosine(&dictionary.decode(code), &text);
            // A code of rounding alone has no direction worth comparing.
            if norm(code) > 1e-3 {
                let found = f64::from(query.score(code));
                prop_assert!((found - expected).abs() < 1e-4, "{found} {expected}");
                let mut halves = KeptCodes::new(CodeForm::F16, 0, 1);
                halves.set(0, code);
                let mut kept = vec![0.0; code.len()];
                halves.add_to(0, 1.0, &mut kept);
                prop_assert!((f64::from(query.score(&kept)) - expected).abs() < 2e-3);
            }
        }
    }
}

#[test]
fn the_first_atoms_hold_what_the_largest_eigenvectors_hold() {
    const N: usize = 48;
    let sequence = Sequence { dimension: N, samples: vec![400], rank: 20, noise: 0.2, seed: 4 };
    let settings = DictionarySettings { first_frames: 2, ..DictionarySettings::default() };
    let mut dictionary = Dictionary::new(N, settings).unwrap();
    assert_eq!(dictionary.learn(&sequence.frame(0)).unwrap(), 0, "one frame is too few");
    let state = dictionary.state();
    let r = scatter(&state);
    let (values, _) = symmetric::<N>(std::array::from_fn(|i| std::array::from_fn(|j| r[i][j])));
    // The same frame again changes nothing but the scale.
    dictionary.learn(&sequence.frame(0)).unwrap();
    let limit = f64::from(settings.threshold) * state.energy;
    let expected = values.iter().filter(|value| **value > limit).count();
    assert!((15..N).contains(&expected), "{values:?}");
    assert!(dictionary.len().abs_diff(expected) <= 1, "{} {expected}", dictionary.len());
    let atoms = (0..dictionary.len()).map(|atom| dictionary.atom(atom).unwrap());
    let held: f64 = atoms.map(|atom| form(&r, atom)).sum();
    let best: f64 = values[..dictionary.len()].iter().sum();
    assert!(held > 0.999 * best, "{held} {best}");
}

#[test]
fn nothing_and_one_direction_and_too_many() {
    let zeros = UnitFeatures::new(vec![0.0; 30 * 40], 40).unwrap();
    let mut dictionary = Dictionary::new(40, DictionarySettings::default()).unwrap();
    for _ in 0..4 {
        assert_eq!(dictionary.learn(&zeros).unwrap(), 0);
    }
    assert!(dictionary.encode(&zeros).unwrap().is_empty());
    assert!(dictionary.query(&[1.0; 40]).unwrap().score(&[]).is_nan());

    let direction = normals(1, 1, 40);
    let one = UnitFeatures::new(direction.repeat(30), 40).unwrap();
    assert_eq!(dictionary.learn(&one).unwrap(), 1);
    assert_eq!(dictionary.learn(&one).unwrap(), 0);
    assert!(cosine(dictionary.atom(0).unwrap(), &direction).abs() > 1.0 - 1e-9);

    let settings = DictionarySettings { capacity: 7, ..DictionarySettings::default() };
    let mut dictionary = Dictionary::new(40, settings).unwrap();
    for frame in 0..4 {
        let many = UnitFeatures::new(normals(frame, 2, 60 * 40), 40).unwrap();
        dictionary.learn(&many).unwrap();
    }
    assert_eq!(dictionary.len(), 7);
    let all = DictionarySettings { threshold: 1e-6, ..DictionarySettings::default() };
    let mut dictionary = Dictionary::new(5, all).unwrap();
    for frame in 0..4 {
        dictionary.learn(&UnitFeatures::new(normals(frame, 2, 60 * 5), 5).unwrap()).unwrap();
    }
    assert_eq!(dictionary.len(), 5, "no more than dimensions");
}

#[test]
fn refusals_name_what_is_wrong() {
    let field = |error: crate::error::Error| error.field().unwrap().to_owned();
    let default = DictionarySettings::default();
    for (settings, name) in [
        (DictionarySettings { decay: 1.0, ..default }, "language.decay"),
        (DictionarySettings { threshold: f32::NAN, ..default }, "language.threshold"),
        (DictionarySettings { capacity: MAX_CAPACITY + 1, ..default }, "language.capacity"),
    ] {
        assert_eq!(field(Dictionary::new(8, settings).unwrap_err()), name);
    }
    let mut dictionary = Dictionary::new(8, default).unwrap();
    let other = UnitFeatures::new(vec![1.0; 9], 9).unwrap();
    assert_eq!(field(dictionary.learn(&other).unwrap_err()), "features");
    assert_eq!(field(dictionary.encode(&other).unwrap_err()), "features");
    assert_eq!(field(dictionary.query(&[1.0; 9]).unwrap_err()), "embedding");
    assert_eq!(field(dictionary.query(&[0.0; 8]).unwrap_err()), "embedding");
    assert_eq!(field(dictionary.query(&[f32::NAN; 8]).unwrap_err()), "embedding");
}

#[test]
fn given_atoms_are_checked_and_never_change() {
    let (x, y) = ([1.0, 0.0, 0.0], [0.0, 0.6, 0.8]);
    let mut dictionary = Dictionary::fixed(&[x, y].concat(), 3).unwrap();
    let features = UnitFeatures::new(normals(1, 1, 300), 3).unwrap();
    for _ in 0..5 {
        assert_eq!(dictionary.learn(&features).unwrap(), 0);
    }
    let state = dictionary.state();
    assert_eq!((state.atoms.as_slice(), dictionary.learns()), ([x, y].concat().as_slice(), false));
    let again = Dictionary::with_state(&state, DictionarySettings::default()).unwrap();
    assert_eq!(again.state(), state);
    for (atoms, problem) in [
        ([x, x].concat(), "atoms[1]: is not orthogonal to atom 0"),
        ([x, [0.0, 0.5, 0.5]].concat(), "atoms[1]: has length"),
        ([[f32::NAN, 0.0, 0.0], y].concat(), "atoms[0]: has length"),
        (vec![], "atoms: 0 numbers"),
        (vec![1.0, 0.0], "atoms: 2 numbers"),
    ] {
        let error = Dictionary::fixed(&atoms, 3).unwrap_err().to_string();
        assert!(error.starts_with(problem), "{error}");
    }
}

#[test]
fn damaged_states_are_refused() {
    let mut dictionary = Dictionary::new(20, DictionarySettings::default()).unwrap();
    for frame in 0..3 {
        dictionary.learn(&UnitFeatures::new(normals(frame, 1, 600), 20).unwrap()).unwrap();
    }
    let good = dictionary.state();
    let open = |state: &DictionaryState| {
        Dictionary::with_state(state, DictionarySettings::default()).map(|_| ())
    };
    open(&good).unwrap();
    let damages: [fn(&mut DictionaryState); 7] = [
        |state| state.atoms[3] += 0.01,
        |state| state.atoms[0] = f32::NAN,
        |state| state.atoms.truncate(19),
        |state| state.scatter.truncate(19),
        |state| state.scatter[0] = f32::INFINITY,
        |state| state.energy = -1.0,
        |state| state.dimension = 0,
    ];
    for (i, damage) in damages.iter().enumerate() {
        let mut state = good.clone();
        damage(&mut state);
        let status = open(&state).unwrap_err().status();
        assert_eq!(status, crate::error::Status::DataLoss, "{i}");
    }
    let small = DictionarySettings { capacity: 2, ..DictionarySettings::default() };
    assert!(Dictionary::with_state(&good, small).is_err(), "more atoms than room");
}

/// The paper's Table IX, MB of 2²⁰ bytes, at 2¹⁶ vertices and d = 1024.
#[test]
fn memory_is_what_the_paper_says() {
    for (capacity, paper_mib) in [(64, 20.5), (128, 36.8), (256, 69.3), (512, 134.3), (1024, 264.3)]
    {
        let settings = DictionarySettings { capacity, ..DictionarySettings::default() };
        let dictionary = Dictionary::new(1024, settings).unwrap();
        let bytes = dictionary.bytes() + Codes::bytes_of(1 << 16, capacity);
        let ratio = bytes as f64 / (paper_mib * f64::from(1 << 20));
        assert!((ratio - 1.0).abs() < 0.02, "{capacity}: {ratio}");
    }
    // Top-K codes: 6.8 and 23.3, with an average's weight at each vertex as above.
    let dictionary = Dictionary::new(1024, DictionarySettings::default()).unwrap();
    for (terms, paper_mib) in [(4, 6.8), (48, 23.3)] {
        let bytes = dictionary.bytes() + KeptCodes::new(CodeForm::TopK, terms, 1 << 16).bytes();
        let ratio = bytes as f64 / (paper_mib * f64::from(1 << 20));
        assert!((ratio - 1.0).abs() < 0.02, "{terms}: {ratio}");
    }
}
