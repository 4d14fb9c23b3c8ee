//! A picture of a slice: distance in colour, contours, unknown space hatched, axes, a scale bar and
//! a colour bar.

use glam::Vec3;
use image::RgbImage;

use super::Slice;
use super::canvas::{Align, Canvas, text_width};
use super::palette::{
    FAINT_INK, INK, PAPER, Rgb, UNKNOWN_GROUND, UNKNOWN_STRIPE, blend, diverging,
};
use super::ticks::{label, round_down, ticks};

/// Distance beyond which the change between neighbouring samples is a jump and not a slope, in
/// samples; as for meshes, a jump is no surface.
const STEEPEST: f32 = 2.0;

/// Layout, pixels. Text of size 2 is 16 high.
const LEFT: i32 = 112;
const TOP: i32 = 84;
const BAR_GAP: i32 = 36;
const BAR_WIDTH: i32 = 24;
const RIGHT: i32 = 184;
const BOTTOM: i32 = 120;
const TEXT: i32 = 2;
const TEXT_HEIGHT: i32 = 16;

/// The share of the colour bar that distances behind surfaces take.
const NEGATIVE_SHARE: f32 = 0.25;

/// Draws a slice.
pub fn draw_slice(slice: &Slice) -> RgbImage {
    let (width, height) = (slice.width as i32, slice.height as i32);
    let mut canvas =
        Canvas::new(LEFT + width + BAR_GAP + BAR_WIDTH + RIGHT, TOP + height + BOTTOM, PAPER);
    let range = Range::of(&slice.distances);
    draw_field(&mut canvas, slice, &range);
    canvas.frame(LEFT, TOP, width, height, INK);
    canvas.text(LEFT, 18, &title(slice), TEXT, Align::Left, INK);
    draw_axes(&mut canvas, slice);
    draw_legend(&mut canvas, slice);
    draw_colour_bar(&mut canvas, LEFT + width + BAR_GAP, height, &range);
    canvas.0
}

/// The distances that the ends of the colour map stand for, m, both positive. Each side has its own
/// scale: behind a surface only centimetres are known, before it metres.
struct Range {
    negative_m: f32,
    positive_m: f32,
    /// Between contours of the positive side, m.
    contour_m: f32,
}

impl Range {
    fn of(distances: &[f32]) -> Self {
        let largest = |side: f32| {
            let mut values: Vec<f32> =
                distances.iter().map(|d| d * side).filter(|d| *d > 0.0 && d.is_finite()).collect();
            // The last per cent is left to saturate, so that a stray value does not pale the rest.
            let rank = values.len() * 99 / 100;
            if values.is_empty() {
                0.0
            } else {
                *values.select_nth_unstable_by(rank, f32::total_cmp).1
            }
        };
        let positive_m = ceiling(largest(1.0).max(0.05));
        Self {
            negative_m: ceiling(largest(-1.0).max(0.05)),
            positive_m,
            contour_m: round_down(positive_m / 4.0),
        }
    }

    fn colour(&self, distance: f32) -> Rgb {
        let limit = if distance < 0.0 { self.negative_m } else { self.positive_m };
        diverging(distance / limit)
    }
}

/// The next round number above: 0.05, 0.1, 0.15 … in steps of half a leading digit.
fn ceiling(value: f32) -> f32 {
    let step = round_down(value) / 2.0;
    (value / step - 1e-3).ceil() * step
}

fn draw_field(canvas: &mut Canvas, slice: &Slice, range: &Range) {
    for row in 0..slice.height {
        for column in 0..slice.width {
            let colour = sample_colour(slice, range, column, row);
            canvas.dot(LEFT + column as i32, TOP + row as i32, colour, 1.0);
        }
    }
}

fn sample_colour(slice: &Slice, range: &Range, column: u32, row: u32) -> Rgb {
    let distance = slice.distances[(row * slice.width + column) as usize];
    if !distance.is_finite() {
        return hatch(column as i32, row as i32);
    }
    let colour = range.colour(distance);
    let slope = slope(slice, column, row);
    // Distance in samples to where the field takes `level`; plateaus and jumps have no contours.
    let sloping = slope > 0.2 * slice.pixel_m && slope < STEEPEST * slice.pixel_m;
    let away = |level: f32| if sloping { (distance - level).abs() / slope } else { f32::INFINITY };
    let line = |away: f32, width: f32| (0.5 * width + 0.5 - away).clamp(0.0, 1.0);
    let nearest = (distance / range.contour_m).round() * range.contour_m;
    let faint = if nearest > 0.0 { line(away(nearest), 0.6) * 0.28 } else { 0.0 };
    blend(blend(colour, INK, faint), INK, line(away(0.0), 2.2))
}

/// Stripes at 45 degrees.
fn hatch(x: i32, y: i32) -> Rgb {
    if (x + y).rem_euclid(10) < 3 { UNKNOWN_STRIPE } else { UNKNOWN_GROUND }
}

/// How much the distance changes from a sample to its neighbours, m, by one-sided differences
/// where only one neighbour is known.
fn slope(slice: &Slice, column: u32, row: u32) -> f32 {
    let value = |c: i64, r: i64| {
        let inside =
            (0..i64::from(slice.width)).contains(&c) && (0..i64::from(slice.height)).contains(&r);
        inside
            .then(|| slice.distances[(r * i64::from(slice.width) + c) as usize])
            .filter(|d| d.is_finite())
    };
    let (c, r) = (i64::from(column), i64::from(row));
    let along =
        |before: Option<f32>, here: Option<f32>, after: Option<f32>| match (before, here, after) {
            (Some(before), Some(here), Some(after)) => {
                (after - here).abs().max((here - before).abs())
            }
            (Some(a), Some(b), None) | (None, Some(a), Some(b)) => (b - a).abs(),
            _ => 0.0,
        };
    let here = value(c, r);
    let x = along(value(c - 1, r), here, value(c + 1, r));
    let y = along(value(c, r - 1), here, value(c, r + 1));
    x.hypot(y)
}

fn title(slice: &Slice) -> String {
    let plane = &slice.plane;
    if plane.normal == Vec3::Z {
        return format!("signed distance at z = {:.2} m", plane.offset_m);
    }
    let Vec3 { x, y, z } = plane.normal;
    format!("signed distance on ({x:.2}, {y:.2}, {z:.2}) . p = {:.2} m", plane.offset_m)
}

/// What an axis is called: a world axis, or its place in the plane.
fn axis_name(axis: Vec3, otherwise: &str) -> String {
    let named = [(Vec3::X, "x"), (Vec3::Y, "y"), (Vec3::Z, "z")];
    let name = named.into_iter().find_map(|(unit, name)| {
        let along = axis.dot(unit);
        (along.abs() > 0.9999).then(|| format!("{}{name}", if along < 0.0 { "-" } else { "" }))
    });
    name.unwrap_or_else(|| otherwise.to_owned())
}

fn draw_axes(canvas: &mut Canvas, slice: &Slice) {
    let (width, height) = (slice.width as i32, slice.height as i32);
    let (low, high) = (slice.at(0, slice.height - 1), slice.at(slice.width - 1, 0));
    let count = |pixels: i32| pixels as f32 / 110.0;
    let columns = ticks(low.x, high.x, count(width));
    let step = |ticks: &[f32]| ticks.windows(2).map(|w| w[1] - w[0]).next().unwrap_or(1.0);
    for &x in &columns {
        let at = LEFT + ((x - low.x) / slice.pixel_m).round() as i32;
        canvas.fill(at, TOP + height, 1, 7, INK);
        let text = label(x, step(&columns));
        canvas.text(at, TOP + height + 12, &text, TEXT, Align::Centre, INK);
    }
    let rows = ticks(low.y, high.y, count(height));
    for &y in &rows {
        let at = TOP + ((high.y - y) / slice.pixel_m).round() as i32;
        canvas.fill(LEFT - 7, at, 7, 1, INK);
        let text = label(y, step(&rows));
        canvas.text(LEFT - 12, at - TEXT_HEIGHT / 2, &text, TEXT, Align::Right, INK);
    }
    let name = format!("{} [m]", axis_name(slice.plane.right, "right"));
    canvas.text(LEFT + width, TOP + height + 36, &name, TEXT, Align::Right, FAINT_INK);
    let name = format!("{} [m]", axis_name(slice.plane.up, "up"));
    canvas.text(LEFT - 12, TOP - 28, &name, TEXT, Align::Right, FAINT_INK);
}

/// Below the axes: the scale bar, and what the line and the hatching mean.
fn draw_legend(canvas: &mut Canvas, slice: &Slice) {
    let top = TOP + slice.height as i32 + 74;
    let length_m = round_down(slice.width as f32 * slice.pixel_m / 4.0);
    let length = (length_m / slice.pixel_m).round() as i32;
    canvas.fill(LEFT, top + 7, length, 4, INK);
    canvas.fill(LEFT, top + 1, 3, 16, INK);
    canvas.fill(LEFT + length - 3, top + 1, 3, 16, INK);
    let text = format!("{} m", label(length_m, length_m));
    canvas.text(LEFT + length + 12, top + 1, &text, TEXT, Align::Left, INK);

    let mut x = LEFT + length + 12 + text_width(&text, TEXT) + 48;
    canvas.fill(x, top + 8, 36, 3, INK);
    canvas.text(x + 46, top + 1, "surface", TEXT, Align::Left, INK);
    x += 46 + text_width("surface", TEXT) + 36;
    for row in 0..18 {
        (0..36).for_each(|column| canvas.dot(x + column, top + row, hatch(column, row), 1.0));
    }
    canvas.frame(x, top, 36, 18, FAINT_INK);
    canvas.text(x + 46, top + 1, "unknown", TEXT, Align::Left, INK);
}

fn draw_colour_bar(canvas: &mut Canvas, x: i32, height: i32, range: &Range) {
    let zero = TOP + (height as f32 * (1.0 - NEGATIVE_SHARE)).round() as i32;
    let (above, below) = ((zero - TOP) as f32, (TOP + height - zero) as f32);
    let place = |distance: f32| {
        if distance < 0.0 {
            zero + (-distance / range.negative_m * below).round() as i32
        } else {
            zero - (distance / range.positive_m * above).round() as i32
        }
    };
    for y in TOP..TOP + height {
        let distance = if y < zero {
            (zero - y) as f32 / above * range.positive_m
        } else {
            (zero - y) as f32 / below * range.negative_m
        };
        canvas.fill(x, y, BAR_WIDTH, 1, range.colour(distance));
    }
    canvas.frame(x, TOP, BAR_WIDTH, height, INK);
    canvas.text(x, TOP - 28, "distance [m]", TEXT, Align::Left, FAINT_INK);
    let mut mark = |distance: f32, step: f32| {
        let y = place(distance);
        canvas.fill(x + BAR_WIDTH, y, 7, 1, INK);
        let text = label(distance, step);
        canvas.text(x + BAR_WIDTH + 12, y - TEXT_HEIGHT / 2, &text, TEXT, Align::Left, INK);
    };
    ticks(0.0, range.positive_m, 4.0).iter().for_each(|&d| mark(d, range.contour_m));
    [-range.negative_m, -range.negative_m / 2.0]
        .iter()
        .for_each(|&d| mark(d, round_down(range.negative_m / 2.0).min(0.05)));
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::super::{Plane, slice};
    use super::*;
    use crate::geometry::Aabb;
    use crate::map::parallel::query_pool;
    use crate::map::query::{Fields, PointAnswers};

    /// A room of 6 × 4 m with a box and a column; known to 0.1 m behind surfaces, and one corner of
    /// the room was never seen.
    fn room(p: Vec3) -> f32 {
        let boxed = |centre: Vec2, half: Vec2| {
            let q = (p.truncate() - centre).abs() - half;
            q.max(Vec2::ZERO).length() + q.max_element().min(0.0)
        };
        let walls = -boxed(Vec2::new(3.0, 2.0), Vec2::new(3.0, 2.0));
        let table = boxed(Vec2::new(4.2, 1.2), Vec2::new(0.6, 0.35));
        let column = p.truncate().distance(Vec2::new(1.6, 2.6)) - 0.3;
        let distance = walls.min(table).min(column);
        let unseen = p.x > 4.9 && p.y > 2.2 + 0.4 * (p.x * 2.0).sin();
        if distance < -0.1 || unseen { f32::NAN } else { distance }
    }

    fn picture(plane: Plane) -> (Slice, RgbImage) {
        let query = |points: &[Vec3], _: Fields| PointAnswers {
            distance: points.iter().map(|&p| room(p)).collect(),
            state: points.iter().map(|&p| u8::from(room(p).is_finite())).collect(),
            ..PointAnswers::default()
        };
        let bounds = Aabb { min: Vec3::new(-0.1, -0.1, 0.0), max: Vec3::new(6.1, 4.1, 2.5) };
        let pool = query_pool(2).expect("pool");
        let slice = slice(&query, &bounds, plane, &pool).expect("inside");
        let image = draw_slice(&slice);
        (slice, image)
    }

    fn pixel(slice: &Slice, image: &RgbImage, x: f32, y: f32) -> Rgb {
        let at = (Vec2::new(x, y) - slice.top_left) / slice.pixel_m;
        let (column, row) = (LEFT + at.x.round() as i32, TOP - at.y.round() as i32);
        image.get_pixel(column as u32, row as u32).0
    }

    #[test]
    fn free_is_blue_behind_is_red_the_surface_dark_and_unknown_hatched() {
        let (slice, image) = picture(Plane::horizontal(1.0).expect("finite"));
        let [r, _, b] = pixel(&slice, &image, 2.9, 1.0);
        assert!(b > r, "free space");
        let [r, _, b] = pixel(&slice, &image, 4.2, 0.94);
        assert!(r > b, "inside the table");
        let dark = (0..7)
            .map(|i| pixel(&slice, &image, 4.2, 0.85 + (i - 3) as f32 * slice.pixel_m))
            .filter(|p| p[0] < 80)
            .count();
        assert!((1..=4).contains(&dark), "a line of {dark} pixels");
        let unknown = pixel(&slice, &image, 5.8, 3.8);
        assert!(unknown == UNKNOWN_GROUND || unknown == UNKNOWN_STRIPE);
        // No contour at the rim of the unknown, where the field just ends.
        let rim = pixel(&slice, &image, 4.89, 3.2);
        assert!(rim[2] > 100, "{rim:?}");
    }

    #[test]
    fn vertical_and_all_unknown_slices_are_drawn_too() {
        let (slice, image) = picture(Plane::new(Vec3::Y, 1.2).expect("a normal"));
        assert!(image.width() > slice.width && image.height() > slice.height);
        let unknown = Slice { distances: vec![f32::NAN; slice.distances.len()], ..slice };
        draw_slice(&unknown);
    }

    #[test]
    fn ranges_end_on_round_numbers() {
        assert!((ceiling(0.1) - 0.1).abs() < 1e-6);
        assert!((ceiling(0.093) - 0.1).abs() < 1e-6);
        assert!((ceiling(1.66) - 2.0).abs() < 1e-6);
        let range = Range::of(&[f32::NAN, 1.4, -0.08]);
        assert!((range.positive_m - 1.5).abs() < 1e-6 && (range.negative_m - 0.1).abs() < 0.026);
    }

    #[test]
    fn axes_are_named_after_the_world() {
        assert_eq!(axis_name(Vec3::X, "right"), "x");
        assert_eq!(axis_name(-Vec3::Y, "right"), "-y");
        assert_eq!(axis_name(Vec3::new(0.6, 0.8, 0.0), "right"), "right");
    }
}
