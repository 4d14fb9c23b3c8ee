//! Free words in the synthetic house: is the best thing what was meant?

use glam::Vec3;

use crate::cli::bench::figure::{Figure, Unit};
use crate::cli::bench::printer::Printer;
use crate::config::{MapConfig, MapSettings};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::encoder::{TextEncoder, features_of};
use crate::map::{FindSettings, MapView, Mapper, Match, Scorer};
use crate::modality::language::NEGATIVES;

/// None of them has a word of the class that it means, and none was chosen after seeing how it does; a
/// few mean either of two.
const QUERIES: [(&str, &[&str]); 24] = [
    ("somewhere to sit", &["chair", "couch"]),
    ("keeps food cold", &["refrigerator"]),
    ("a place to sleep", &["bed"]),
    ("wash your hands", &["sink"]),
    ("cook a meal", &["stove"]),
    ("see your own face", &["mirror"]),
    ("light for reading", &["lamp"]),
    ("watch a movie", &["television"]),
    ("what time is it", &["clock"]),
    ("needs watering", &["plant"]),
    ("a painting", &["picture"]),
    ("blocks sunlight", &["curtain"]),
    ("carpet", &["rug"]),
    ("rest your head", &["pillow"]),
    ("keeps you warm at night", &["blanket"]),
    ("dry yourself", &["towel"]),
    ("hang up clothes", &["wardrobe"]),
    ("something to read", &["book"]),
    ("take a long soak", &["bathtub"]),
    ("flush", &["toilet"]),
    ("look outside", &["window"]),
    ("eat dinner here", &["table"]),
    ("leave the room", &["door"]),
    ("where the cups are", &["cabinet", "shelf"]),
];
/// Things that are looked at for each.
const TOP: usize = 3;
/// A labelled pixel is part of a thing if it fits as well as this share of the thing.
const FITS: f32 = 0.9;

/// Points of surfaces and the places of their classes.
struct Labelled {
    points: Vec<Vec3>,
    classes: Vec<u16>,
    names: Vec<String>,
}

/// Maps the house with the embeddings of its classes' names, and asks.
pub(super) fn run(
    data: &Synthetic,
    encoder: &TextEncoder,
    settings: &MapSettings,
    out: &mut Printer,
) -> anyhow::Result<()> {
    let mut mapper = Mapper::new(MapConfig::from_settings(settings)?)?;
    let mut truth = Labelled { points: Vec::new(), classes: Vec::new(), names: Vec::new() };
    for index in 0..data.len() {
        let mut frame = data.load(index, true)?;
        if let Some(labels) = data.labels(index)? {
            frame.features = Some(features_of(&labels, encoder)?);
            let (k, places) = (frame.intrinsics, labels.places());
            for pixel in (0..k.pixels()).step_by(61) {
                let (u, v) = ((pixel % k.width as usize) as u32, (pixel / k.width as usize) as u32);
                let (z, class) = (frame.depth.at(u, v), places[pixel]);
                if z > 0.0 && usize::from(class) < labels.classes.len() {
                    truth.points.push(frame.world_point(u, v, z));
                    truth.classes.push(class);
                }
            }
            truth.names = labels.classes.iter().map(|class| class.name.clone()).collect();
        }
        mapper.integrate(&frame)?;
    }
    let view = mapper.publish();
    let id = &encoder.contract().encoder_id;
    for (how, negatives) in [("relevancy", &NEGATIVES[..]), ("cosine", &[])] {
        let negatives = encoder.embed(negatives)?;
        let name = format!("words in the house, {id}, by {how}");
        let (mut first, mut third) = (0.0, 0.0);
        for (query, meant) in QUERIES {
            let scorer = view.scorer(&encoder.embed(&[query])?, &negatives)?;
            let settings = FindSettings { region: None, min_score: 0.0, top_k: TOP, places: false };
            let things = view.find(&scorer, &settings, &|| false).unwrap_or_default().matches;
            let found: Vec<&str> =
                things.iter().map(|thing| truth.class_of(&view, &scorer, thing)).collect();
            let hit = |found: &&str| meant.contains(found);
            first += f64::from(u8::from(found.first().is_some_and(hit)));
            third += f64::from(u8::from(found.iter().any(hit)));
            let best = things.first().map_or(f64::NAN, |thing| f64::from(thing.score));
            let line = format!("{query}: {} ({})", found.join(", "), meant.join(" or "));
            out.figures([Figure::new(&name, line, best, Unit::Share)])?;
        }
        let count = QUERIES.len() as f64;
        out.figures([
            Figure::new(&name, "best_is_meant", first / count, Unit::Share),
            Figure::new(&name, format!("meant_among_{TOP}"), third / count, Unit::Share),
        ])?;
    }
    Ok(())
}

impl Labelled {
    /// The class that most of a thing belongs to.
    fn class_of(&self, view: &MapView, scorer: &Scorer, thing: &Match) -> &str {
        let turn = thing.obb.rotation.inverse();
        let inside = |point: &Vec3| {
            (turn * (*point - thing.obb.center)).abs().cmple(thing.obb.half_size).all()
        };
        let within: Vec<usize> =
            (0..self.points.len()).filter(|i| inside(&self.points[*i])).collect();
        let points: Vec<Vec3> = within.iter().map(|i| self.points[*i]).collect();
        let mut counts = vec![0; self.names.len()];
        for (i, score) in within.into_iter().zip(view.text_scores(&points, scorer)) {
            if score >= FITS * thing.score {
                counts[usize::from(self.classes[i])] += 1;
            }
        }
        let most = counts.iter().enumerate().max_by_key(|(class, n)| (**n, usize::MAX - class));
        most.filter(|(_, n)| **n > 0).map_or("nothing", |(class, _)| &self.names[class])
    }
}
