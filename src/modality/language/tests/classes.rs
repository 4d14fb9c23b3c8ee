//! Classes whose cones of features overlap (paper Fig. 4): what codes lose, and what they win.
//!
//! A feature is the mean that all share, its class, where it stands in the scene, from where it was
//! seen, and noise: most of the energy is the mean's, and little of the rest tells the class. The
//! numbers are chosen so that a single feature is often ambiguous, as in the paper, and averages
//! over what a vertex saw are not.

use super::*;

const DIMENSION: usize = 512;
const CLASSES: usize = 15;
const VERTICES: usize = 600;
const FRAMES: usize = 12;
/// Vertices that a frame sees.
const SEEN: usize = 200;
/// Directions in which features differ whatever their class.
const NUISANCES: usize = 300;

/// A vector of random direction and some length.
fn direction(stream: u32, length: f32) -> Vec<f32> {
    let vector = normals(11, stream, DIMENSION);
    let scale = length / norm(&vector) as f32;
    vector.into_iter().map(|x| x * scale).collect()
}

fn add(to: &mut [f32], scale: f32, from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(to, x)| *to += scale * x);
}

struct Scene {
    /// What the features of a class have in common, the mean of all included.
    classes: Vec<Vec<f32>>,
    texts: Vec<Vec<f32>>,
    nuisances: Vec<Vec<f32>>,
    /// The vertices that each frame sees, and their features.
    frames: Vec<(Vec<usize>, UnitFeatures)>,
}

impl Scene {
    fn new() -> Self {
        let mean = direction(0, 1.0);
        let classes: Vec<Vec<f32>> = (0..CLASSES as u32)
            .map(|class| {
                let mut feature = direction(1 + class, 0.35);
                // Neighbours in this order resemble each other.
                add(&mut feature, 1.0, &direction(100 + class / 3, 0.3));
                add(&mut feature, 0.8, &mean);
                feature
            })
            .collect();
        // Texts share little with images but the class, and much with each other.
        let texts = (0..CLASSES as u32)
            .map(|class| {
                let mut text = direction(200 + class, 0.35);
                add(&mut text, 0.5, &direction(99, 1.0));
                add(&mut text, 1.0, &direction(1 + class, 0.3));
                add(&mut text, 1.0, &direction(100 + class / 3, 0.3));
                text
            })
            .collect();
        let nuisances = (0..NUISANCES as u32)
            .map(|k| direction(1000 + k, 0.25 / (1.0 + k as f32 / 40.0).sqrt()))
            .collect();
        let mut scene = Self { classes, texts, nuisances, frames: Vec::new() };
        scene.frames = (0..FRAMES).map(|frame| scene.frame(frame)).collect();
        scene
    }

    fn class(vertex: usize) -> usize {
        vertex % CLASSES
    }

    /// What a frame sees of a vertex: half of the nuisance is the place's, half the view's.
    fn feature(&self, vertex: usize, frame: usize) -> Vec<f32> {
        let mut feature = self.classes[Self::class(vertex)].clone();
        let place = normals(21, vertex as u32, NUISANCES);
        let view = normals(22, (vertex * FRAMES + frame) as u32, NUISANCES);
        for (k, nuisance) in self.nuisances.iter().enumerate() {
            add(&mut feature, 0.4 * (place[k] + view[k]), nuisance);
        }
        let noise = normals(23, (vertex * FRAMES + frame) as u32, DIMENSION);
        add(&mut feature, 0.8 / (DIMENSION as f32).sqrt(), &noise);
        feature
    }

    fn frame(&self, frame: usize) -> (Vec<usize>, UnitFeatures) {
        let seen: Vec<usize> = (0..SEEN).map(|i| (frame * 50 + i) % VERTICES).collect();
        let values = seen.iter().flat_map(|vertex| self.feature(*vertex, frame)).collect();
        (seen, UnitFeatures::new(values, DIMENSION).unwrap())
    }
}

/// The shares of vertices whose best text is that of their class, and mean average precision by
/// relevancy against the other texts.
fn judge(scores: impl Fn(usize, usize) -> f32) -> (f64, f64) {
    let all: Vec<Vec<f32>> =
        (0..VERTICES).map(|v| (0..CLASSES).map(|c| scores(v, c)).collect()).collect();
    let best = |row: &[f32]| (0..CLASSES).max_by(|a, b| row[*a].total_cmp(&row[*b]));
    let right = (0..VERTICES).filter(|v| best(&all[*v]) == Some(Scene::class(*v))).count();
    let precision = |class: usize| {
        let relevant = |row: &[f32]| {
            let others: Vec<f32> = (0..CLASSES).filter(|c| *c != class).map(|c| row[c]).collect();
            relevancy(row[class], &others, TEMPERATURE)
        };
        let mut ranked: Vec<(f32, bool)> = all
            .iter()
            .enumerate()
            .map(|(v, row)| (relevant(row), Scene::class(v) == class))
            .collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut found, mut sum) = (0.0, 0.0);
        for (i, _) in ranked.iter().enumerate().filter(|(_, r)| r.1) {
            found += 1.0;
            sum += found / (i + 1) as f64;
        }
        sum / found
    };
    let precisions: f64 = (0..CLASSES).map(precision).sum();
    (right as f64 / VERTICES as f64, precisions / CLASSES as f64)
}

/// Codes of all vertices after all frames, by a dictionary that learns as they come.
fn map(scene: &Scene, mut dictionary: Dictionary) -> (Dictionary, Codes) {
    let mut codes = Codes::new(dictionary.capacity());
    codes.resize(VERTICES).unwrap();
    let mut rows = [crate::octree::NO_VERTEX; 8];
    for (seen, features) in &scene.frames {
        dictionary.learn(features).unwrap();
        let encoded = dictionary.encode(features).unwrap();
        for (i, vertex) in seen.iter().enumerate() {
            rows[0] = *vertex as u32;
            let code = &encoded[i * dictionary.len()..(i + 1) * dictionary.len()];
            codes.observe(&rows, &[1.0; 8], code);
        }
    }
    (dictionary, codes)
}

fn judge_codes(scene: &Scene, dictionary: &Dictionary, codes: &Codes) -> (f64, f64) {
    let queries: Vec<Query> = scene.texts.iter().map(|t| dictionary.query(t).unwrap()).collect();
    judge(|vertex, class| queries[class].score(codes.code(vertex)))
}

#[test]
fn codes_tell_classes_apart_as_full_features_do() {
    let scene = Scene::new();
    // Full features are codes over all axes.
    let axes: Vec<f32> =
        (0..DIMENSION * DIMENSION).map(|i| f32::from(u8::from(i % (DIMENSION + 1) == 0))).collect();
    let (axes, full) = map(&scene, Dictionary::fixed(&axes, DIMENSION).unwrap());
    let (full_right, full_precision) = judge_codes(&scene, &axes, &full);
    let mut firsts: Vec<&[f32]> = vec![&[]; VERTICES];
    for (seen, features) in scene.frames.iter().rev() {
        seen.iter().zip(features.iter()).for_each(|(vertex, feature)| firsts[*vertex] = feature);
    }
    let (single_right, _) =
        judge(|vertex, class| cosine(firsts[vertex], &scene.texts[class]) as f32);
    println!("full {full_right:.3} {full_precision:.3}, first features alone {single_right:.3}");
    assert!(single_right < full_right - 0.02, "averages tell more than single features");

    let mut dense = Vec::new();
    for capacity in [16, 64, 128, 256] {
        let settings = DictionarySettings { capacity, ..DictionarySettings::default() };
        let (dictionary, codes) = map(&scene, Dictionary::new(DIMENSION, settings).unwrap());
        let cosines = (0..VERTICES)
            .map(|v| cosine(&dictionary.decode(codes.code(v)), &full.code(v)[..DIMENSION]));
        let fidelity = cosines.sum::<f64>() / VERTICES as f64;
        let (right, precision) = judge_codes(&scene, &dictionary, &codes);
        let atoms = dictionary.len();
        println!("{capacity}: {atoms} atoms, cosine {fidelity:.3}, {right:.3} {precision:.3}");
        dense.push((fidelity, right, precision));
    }
    for pair in dense.windows(2) {
        assert!(pair[1].0 > pair[0].0 && pair[1].1 > pair[0].1, "{pair:?}");
    }
    let (fidelity, right, precision) = dense[3];
    // What is asked for is right long before features are.
    assert!(right > full_right - 0.03 && precision > full_precision - 0.005);
    assert!(fidelity < 0.95, "{fidelity}");
    assert!(dense[2].2 > full_precision - 0.01 && dense[1].2 > full_precision - 0.05);
}

/// [`judge`] of codes in the form that a view holds them in.
fn judge_kept(queries: &[Query], codes: &Codes, form: CodeForm, terms: usize) -> (f64, f64) {
    let mut kept = KeptCodes::new(form, terms, VERTICES);
    (0..VERTICES).for_each(|v| kept.set(v, codes.code(v)));
    judge(|vertex, class| {
        let mut code = vec![0.0; codes.code(vertex).len()];
        kept.add_to(vertex, 1.0, &mut code);
        queries[class].score(&code)
    })
}

#[test]
fn few_large_coefficients_tell_less_and_atoms_known_before_no_less() {
    let scene = Scene::new();
    let learning = Dictionary::new(DIMENSION, DictionarySettings::default()).unwrap();
    let (dictionary, codes) = map(&scene, learning);
    assert!((64..256).contains(&dictionary.len()), "the threshold ends growth, not the capacity");
    let (dense_right, dense_precision) = judge_codes(&scene, &dictionary, &codes);
    let queries: Vec<Query> = scene.texts.iter().map(|t| dictionary.query(t).unwrap()).collect();
    let mut before = 0.0;
    for (terms, least) in [(4, 0.2), (16, 0.6), (48, dense_right - 0.08)] {
        let (right, precision) = judge_kept(&queries, &codes, CodeForm::TopK, terms);
        println!("top-{terms}: {right:.3} {precision:.3}");
        assert!(right > least && precision > before && right < dense_right);
        before = precision;
    }
    let (right, precision) = judge_kept(&queries, &codes, CodeForm::F16, 0);
    println!("halves: {right:.3} {precision:.3}");
    assert!((right - dense_right).abs() < 0.005 && (precision - dense_precision).abs() < 0.001);

    let atoms = dictionary.state().atoms;
    let (offline, codes) = map(&scene, Dictionary::fixed(&atoms, DIMENSION).unwrap());
    let (right, precision) = judge_codes(&scene, &offline, &codes);
    println!("offline: {right:.3} {precision:.3}");
    assert!(right >= dense_right && precision > dense_precision - 0.002);
}
