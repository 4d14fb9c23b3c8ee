//! How well classes are told apart, from the cosine of each class at each place.

/// A class counts if at least one place of so many has it.
const PRESENT: usize = 1000;

/// Means over the classes that count; NaN where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassScores {
    /// Intersection over union.
    pub miou: f64,
    /// The share of a class's places that are taken for it.
    pub macc: f64,
    /// Average precision.
    pub map: f64,
    /// The mean cosine of a place with its own class.
    pub cosine: f64,
    /// The share of the places that the map knows; the rest is left out of all means.
    pub known_share: f64,
    /// The number of classes that count.
    pub classes: usize,
}

impl ClassScores {
    /// Of no places.
    pub(super) const NONE: Self = Self {
        miou: f64::NAN,
        macc: f64::NAN,
        map: f64::NAN,
        cosine: f64::NAN,
        known_share: f64::NAN,
        classes: 0,
    };
}

/// Judges `scores`, the cosines of `count` classes place by place, by the number of each place's true
/// class. Rows of NaN, and rows that are not there, are unknown.
///
/// A place is taken for the class of the largest cosine among those that count. Average precision ranks
/// places by the relevancy of the class against the others, which is the order of its lead over the
/// best of them; places of the same lead count together.
pub fn class_scores(scores: &[f32], truth: &[u16], count: usize) -> ClassScores {
    let mut places = vec![0usize; count];
    truth.iter().for_each(|class| places[usize::from(*class)] += 1);
    let present: Vec<usize> =
        (0..count).filter(|c| places[*c] > 0 && places[*c] * PRESENT >= truth.len()).collect();
    let number: Vec<Option<usize>> =
        (0..count).map(|class| present.iter().position(|p| *p == class)).collect();
    let judged = truth.iter().filter(|class| number[usize::from(**class)].is_some()).count();
    // The cosines of the classes that count, and which of them is true.
    let known: Vec<(usize, Vec<f32>)> = scores
        .chunks_exact(count.max(1))
        .zip(truth)
        .filter(|(row, _)| row.iter().all(|score| score.is_finite()))
        .filter_map(|(row, class)| {
            let own = number[usize::from(*class)]?;
            Some((own, present.iter().map(|class| row[*class]).collect()))
        })
        .collect();
    let mut tally = vec![Tally::default(); present.len()];
    for (own, row) in &known {
        let taken_for = best(row);
        tally[*own].places += 1;
        if taken_for == *own {
            tally[*own].right += 1;
        } else {
            tally[taken_for].wrong += 1;
        }
    }
    let met: Vec<usize> = (0..present.len()).filter(|class| tally[*class].places > 0).collect();
    let over = |of: &dyn Fn(usize) -> f64| mean(met.iter().map(|class| of(*class)));
    ClassScores {
        miou: over(&|class| tally[class].iou()),
        macc: over(&|class| tally[class].right as f64 / tally[class].places as f64),
        map: over(&|class| average_precision(&known, class)),
        cosine: mean(known.iter().map(|(own, row)| f64::from(row[*own]))),
        known_share: known.len() as f64 / judged as f64,
        classes: present.len(),
    }
}

/// What became of the places of a class.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    places: usize,
    right: usize,
    /// Places of others that were taken for it.
    wrong: usize,
}

impl Tally {
    fn iou(self) -> f64 {
        self.right as f64 / (self.places + self.wrong) as f64
    }
}

/// The first of the largest.
fn best(row: &[f32]) -> usize {
    (1..row.len()).fold(0, |best, i| if row[i] > row[best] { i } else { best })
}

/// The area under precision over recall, in steps.
fn average_precision(known: &[(usize, Vec<f32>)], class: usize) -> f64 {
    let lead = |row: &[f32]| {
        let others = row.iter().enumerate().filter(|(i, _)| *i != class);
        row[class] - others.map(|(_, score)| *score).fold(-1.0, f32::max)
    };
    let mut ranked: Vec<(f32, bool)> =
        known.iter().map(|(own, row)| (lead(row), *own == class)).collect();
    ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let (mut taken, mut right, mut area) = (0, 0, 0.0);
    for equal in ranked.chunk_by(|a, b| a.0 == b.0) {
        let more = equal.iter().filter(|place| place.1).count();
        (taken, right) = (taken + equal.len(), right + more);
        area += more as f64 * right as f64 / taken as f64;
    }
    area / right as f64
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), x| (sum + x, count + 1));
    sum / f64::from(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNKNOWN: [f32; 3] = [f32::NAN; 3];

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-6
    }

    #[test]
    fn a_right_map_scores_one() {
        let scores = [[0.9, 0.1, 0.2], [0.1, 0.8, 0.0], [0.0, 0.2, 0.7]].concat();
        let found = class_scores(&scores, &[0, 1, 2], 3);
        let perfect = ClassScores {
            miou: 1.0,
            macc: 1.0,
            map: 1.0,
            cosine: found.cosine,
            known_share: 1.0,
            classes: 3,
        };
        assert_eq!(found, perfect);
        assert!(close(found.cosine, 0.8));
    }

    #[test]
    fn confusion_costs_both_classes() {
        // Four places: two chairs, of which one is taken for a table; two tables.
        let scores = [[0.9, 0.1, 0.0], [0.3, 0.5, 0.0], [0.2, 0.6, 0.0], [0.1, 0.9, 0.0]].concat();
        let found = class_scores(&scores, &[0, 0, 1, 1], 3);
        assert_eq!(found.classes, 2, "nothing is of class 2");
        assert!(close(found.miou, (0.5 + 2.0 / 3.0) / 2.0), "{found:?}");
        assert!(close(found.macc, 0.75), "{found:?}");
        // By their lead, chairs still come before tables, and tables before chairs.
        assert!(close(found.map, 1.0), "{found:?}");
        // Taken the other way round, the one chair that leads is the last of four.
        let found = class_scores(&scores, &[1, 0, 0, 0], 3);
        let table = 1.0 / 4.0;
        let chairs = (1.0 / 2.0 + 2.0 / 3.0 + 3.0 / 4.0) / 3.0;
        assert!(close(found.map, (table + chairs) / 2.0), "{found:?}");
    }

    #[test]
    fn unknown_places_and_rare_classes_are_left_out() {
        let rows = [[0.9, 0.1, 0.0], UNKNOWN, [0.1, 0.9, 0.0]].concat();
        // The fourth place has no row at all.
        let found = class_scores(&rows, &[0, 0, 1, 1], 3);
        assert_eq!((found.miou, found.map, found.known_share), (1.0, 1.0, 0.5));
        let mut truth = vec![0; 2000];
        let mut rows: Vec<f32> = [0.9, 0.1, 0.0].repeat(2000);
        (truth[0], truth[1], truth[2]) = (1, 2, 2);
        rows[3..6].copy_from_slice(&[0.0, 0.1, 0.9]);
        let found = class_scores(&rows, &truth, 3);
        // One place of 2000 is too few, two are enough.
        assert_eq!((found.classes, found.known_share), (2, 1.0));
        assert!(close(found.macc, (1.0 + 0.5) / 2.0), "{found:?}");
        let nothing = class_scores(&[], &[0, 1], 3);
        assert!(nothing.miou.is_nan() && nothing.known_share == 0.0 && nothing.classes == 2);
    }

    #[test]
    fn equal_scores_rank_together() {
        let scores = [0.5, 0.5, 0.0].repeat(4);
        let found = class_scores(&scores, &[0, 1, 1, 1], 3);
        assert!(close(found.map, (0.25 + 0.75) / 2.0), "as good as drawing lots: {found:?}");
    }
}
