//! The colour of a ray and its derivatives: the paper's volume rendering (eq:volrender) with the
//! density of [`super::density`].
//!
//! A ray passes pieces of voxels; piece i has the signed distances a and b at its ends, lets the
//! share q = min(1, Φ(b) / Φ(a)) of the light T that reaches it pass, and takes the weight
//! w = T (1 − q). Its colour c is that at the linear zero crossing if a > 0 ≥ b, else at the middle.
//! The ray's colour is Ĉ = Σ w c / Σ w. Surfaces are seen from their front: pieces before the first
//! with a > 0 take nothing.

use glam::Vec3;

use super::density::{lit, passes};

/// A piece of a voxel on a ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Piece {
    /// Where it begins and ends, in lengths of the ray's direction.
    pub t: [f32; 2],
    /// Signed distances there, m.
    pub f: [f32; 2],
}

/// What a piece takes of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Index of the piece.
    pub piece: usize,
    pub weight: f32,
    /// Where its colour is taken, ...
    pub t: f32,
    /// ... and how that depends on the distances at its ends.
    t_by_f: [f32; 2],
    /// The light that reaches it.
    light: f32,
}

/// The colour of a share.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Shade {
    pub color: Vec3,
    /// ∂c/∂t.
    pub along: Vec3,
}

/// Divides the light of a ray among its pieces, of which it leaves those with a weight.
pub fn divide(pieces: &[Piece], sharpness: f32, shares: &mut Vec<Share>) {
    let mut light = 1.0;
    let in_front = pieces.iter().position(|piece| piece.f[0] > 0.0).unwrap_or(pieces.len());
    for (i, piece) in pieces.iter().enumerate().skip(in_front) {
        let passed = light * passes(piece.f[0], piece.f[1], sharpness);
        if passed < light {
            let (t, t_by_f) = crossing(piece);
            shares.push(Share { piece: i, weight: light - passed, t, t_by_f, light });
        }
        light = passed;
    }
}

fn crossing(Piece { t: [begin, end], f: [a, b] }: &Piece) -> (f32, [f32; 2]) {
    let length = end - begin;
    if !(*a > 0.0 && *b <= 0.0) {
        return (begin + 0.5 * length, [0.0; 2]);
    }
    let fall = a - b;
    (begin + length * (a / fall), [-length * b / (fall * fall), length * a / (fall * fall)])
}

/// Ĉ, and the light that was taken.
pub fn mix(shares: &[Share], shades: &[Shade]) -> (Vec3, f32) {
    let taken: f32 = shares.iter().map(|share| share.weight).sum();
    let sum: Vec3 =
        shares.iter().zip(shades).map(|(share, shade)| shade.color * share.weight).sum();
    (if taken > 0.0 { sum / taken } else { Vec3::ZERO }, taken)
}

/// Derivatives of a loss from ∂L/∂Ĉ: by the colour of each share, into `by_colors`, and by the
/// distances at both ends of each piece, added to `by_f`.
pub fn backward(
    sharpness: f32,
    pieces: &[Piece],
    (shares, shades): (&[Share], &[Shade]),
    by_mixed: Vec3,
    by_colors: &mut Vec<Vec3>,
    by_f: &mut [[f32; 2]],
) {
    let (mixed, taken) = mix(shares, shades);
    by_colors.clear();
    by_colors.extend(shares.iter().map(|share| by_mixed * (share.weight / taken)));
    // Σ w ∂L/∂w over the pieces behind.
    let mut behind = 0.0;
    for (share, shade) in shares.iter().zip(shades).rev() {
        let by_weight = by_mixed.dot(shade.color - mixed) / taken;
        // ∂L/∂ ln q: q lowers the own weight T (1 − q) and scales those behind.
        let passed = share.light - share.weight;
        let by_log = behind - passed * by_weight;
        behind += share.weight * by_weight;
        let by_t = by_mixed.dot(shade.along) * (share.weight / taken);
        let [a, b] = pieces[share.piece].f;
        // d ln Φ(f) / df = s (1 − Φ(f)).
        let slope = |f: f32| sharpness * (1.0 - lit(f, sharpness));
        let by = &mut by_f[share.piece];
        by[0] += share.t_by_f[0] * by_t - by_log * slope(a);
        by[1] += share.t_by_f[1] * by_t + by_log * slope(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: f32 = 60.0;

    fn pieces(f: &[f32]) -> Vec<Piece> {
        let ends = f.windows(2).enumerate();
        ends.map(|(i, f)| Piece { t: [0.1 * i as f32, 0.1 * (i + 1) as f32], f: [f[0], f[1]] })
            .collect()
    }

    /// A colour that varies along the ray.
    fn shade(t: f32) -> Shade {
        let phase = Vec3::new(7.0, 11.0, 13.0) * t;
        let color = Vec3::new(phase.x.sin(), phase.y.cos(), phase.z.sin()) * 0.4 + 0.5;
        let slope = Vec3::new(phase.x.cos(), -phase.y.sin(), phase.z.cos()) * 0.4;
        Shade { color, along: slope * Vec3::new(7.0, 11.0, 13.0) }
    }

    fn rendered(f: &[f32], by: &[Vec3]) -> (Vec3, f32) {
        let mut shares = Vec::new();
        divide(&pieces(f), S, &mut shares);
        let shade = |share: &Share| {
            let shade = shade(share.t);
            Shade { color: shade.color + by[share.piece], ..shade }
        };
        let shades: Vec<Shade> = shares.iter().map(shade).collect();
        mix(&shares, &shades)
    }

    const RAYS: [&[f32]; 4] = [
        &[0.08, 0.05, 0.02, -0.01, -0.04, -0.07],
        &[0.09, 0.03, 0.012, 0.02, 0.05, 0.03, -0.02],
        &[-0.02, 0.01, 0.004, -0.03, -0.05],
        &[0.05, 0.045, 0.03, 0.02],
    ];

    #[test]
    fn derivatives_are_central_differences() {
        let by_mixed = Vec3::new(0.7, -0.4, 0.9);
        for f in RAYS {
            let (pieces, zero) = (pieces(f), vec![Vec3::ZERO; f.len()]);
            let (mut shares, mut by_colors) = (Vec::new(), Vec::new());
            divide(&pieces, S, &mut shares);
            let shades: Vec<Shade> = shares.iter().map(|share| shade(share.t)).collect();
            let mut by_f = vec![[0.0; 2]; pieces.len()];
            backward(S, &pieces, (&shares, &shades), by_mixed, &mut by_colors, &mut by_f);
            for end in 0..f.len() {
                // An end belongs to two pieces.
                let mut found = by_f.get(end).map_or(0.0, |by| by[0]);
                found += if end > 0 { by_f[end - 1][1] } else { 0.0 };
                let loss = |by: f32| {
                    let mut moved = f.to_vec();
                    moved[end] += by;
                    rendered(&moved, &zero).0.dot(by_mixed)
                };
                let expected = (loss(1e-4) - loss(-1e-4)) / 2e-4;
                assert!(
                    (found - expected).abs() < 0.02 + 0.01 * expected.abs(),
                    "{f:?} {end}: {found} {expected}"
                );
            }
            for (share, found) in shares.iter().zip(&by_colors) {
                let loss = |by: f32| {
                    let mut moved = zero.clone();
                    moved[share.piece].y = by;
                    rendered(f, &moved).0.dot(by_mixed)
                };
                let expected = (loss(1e-2) - loss(-1e-2)) / 2e-2;
                assert!((found.y - expected).abs() < 1e-3, "{f:?}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_surface_that_is_crossed_gives_its_own_colour() {
        let (color, taken) = rendered(RAYS[0], &[Vec3::ZERO; 6]);
        assert!((taken - 0.985).abs() < 0.02, "{taken}");
        let mut shares = Vec::new();
        divide(&pieces(&[0.9, -0.9]), 200.0, &mut shares);
        assert_eq!(shares.len(), 1);
        assert!((shares[0].t - 0.05).abs() < 1e-6 && shares[0].weight > 0.999);
        assert!(color.is_finite());
    }

    #[test]
    fn what_is_met_from_behind_takes_nothing() {
        let mut shares = Vec::new();
        divide(&pieces(&[-0.05, -0.02, 0.03, 0.06]), S, &mut shares);
        assert!(shares.is_empty());
        assert_eq!(mix(&[], &[]), (Vec3::ZERO, 0.0));
    }
}
