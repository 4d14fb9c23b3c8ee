//! Drawing on an RGB image: rectangles, lines and lettering. Whatever falls outside is cut off.

use font8x8::legacy::BASIC_LEGACY;
use image::{Rgb as Pixel, RgbImage};

use super::palette::{Rgb, blend};

/// Pixels of a font cell along each side at size 1.
const CELL: i32 = 8;

/// Where text lies relative to its x coordinate.
#[derive(Clone, Copy)]
pub(super) enum Align {
    Left,
    Centre,
    Right,
}

/// An image to draw on; x to the right, y down.
pub(super) struct Canvas(pub RgbImage);

impl Canvas {
    pub(super) fn new(width: i32, height: i32, ground: Rgb) -> Self {
        Self(RgbImage::from_pixel(width.max(1) as u32, height.max(1) as u32, Pixel(ground)))
    }

    /// Lays a colour on a pixel.
    pub(super) fn dot(&mut self, x: i32, y: i32, color: Rgb, alpha: f32) {
        if x < 0 || y < 0 {
            return;
        }
        if let Some(pixel) = self.0.get_pixel_mut_checked(x as u32, y as u32) {
            pixel.0 = blend(pixel.0, color, alpha);
        }
    }

    /// A filled rectangle.
    pub(super) fn fill(&mut self, x: i32, y: i32, width: i32, height: i32, color: Rgb) {
        for row in y..y + height {
            (x..x + width).for_each(|column| self.dot(column, row, color, 1.0));
        }
    }

    /// The border around a rectangle, one pixel wide, just outside it.
    pub(super) fn frame(&mut self, x: i32, y: i32, width: i32, height: i32, color: Rgb) {
        self.fill(x - 1, y - 1, width + 2, 1, color);
        self.fill(x - 1, y + height, width + 2, 1, color);
        self.fill(x - 1, y, 1, height, color);
        self.fill(x + width, y, 1, height, color);
    }

    /// A line of text whose cells start at `y`; characters beyond ASCII show as '?'.
    pub(super) fn text(&mut self, x: i32, y: i32, text: &str, size: i32, align: Align, color: Rgb) {
        let width = text_width(text, size);
        let left = match align {
            Align::Left => x,
            Align::Centre => x - width / 2,
            Align::Right => x - width,
        };
        for (i, letter) in text.chars().enumerate() {
            let glyph = BASIC_LEGACY.get(letter as usize).unwrap_or(&BASIC_LEGACY[63]);
            self.glyph(left + i as i32 * CELL * size, y, glyph, size, color);
        }
    }

    fn glyph(&mut self, x: i32, y: i32, glyph: &[u8; 8], size: i32, color: Rgb) {
        for row in 0..CELL * size {
            for column in 0..CELL * size {
                let alpha = coverage(glyph, column, row, size);
                if alpha > 0.0 {
                    self.dot(x + column, y + row, color, alpha);
                }
            }
        }
    }
}

/// The width of a line of text, pixels.
pub(super) fn text_width(text: &str, size: i32) -> i32 {
    text.chars().count() as i32 * CELL * size
}

/// How much of a pixel a magnified glyph covers: the bitmap interpolated and sharpened, which
/// rounds the steps of its diagonals.
fn coverage(glyph: &[u8; 8], column: i32, row: i32, size: i32) -> f32 {
    let bit = |x: i32, y: i32| {
        let inside = (0..CELL).contains(&x) && (0..CELL).contains(&y);
        f32::from(u8::from(inside && glyph[y.clamp(0, 7) as usize] >> x.clamp(0, 7) & 1 == 1))
    };
    let place = |i: i32| (i as f32 + 0.5) / size as f32 - 0.5;
    let (x, y) = (place(column), place(row));
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let (x0, y0) = (x0 as i32, y0 as i32);
    let top = bit(x0, y0) * (1.0 - fx) + bit(x0 + 1, y0) * fx;
    let bottom = bit(x0, y0 + 1) * (1.0 - fx) + bit(x0 + 1, y0 + 1) * fx;
    let value = top * (1.0 - fy) + bottom * fy;
    ((value - 0.35) / 0.4).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::slice::palette::{INK, PAPER};

    fn dark_pixels(canvas: &Canvas) -> usize {
        canvas.0.pixels().filter(|p| p.0[0] < 128).count()
    }

    #[test]
    fn shapes_are_cut_off_at_the_border() {
        let mut canvas = Canvas::new(10, 10, PAPER);
        canvas.fill(-5, -5, 8, 8, INK);
        assert_eq!(dark_pixels(&canvas), 9);
        canvas.text(6, 6, "W\u{00b5}", 2, Align::Left, INK);
        canvas.frame(0, 0, 10, 10, INK);
        assert!(dark_pixels(&canvas) > 9);
    }

    #[test]
    fn letters_are_drawn_where_they_are_aligned() {
        let columns = |align| {
            let mut canvas = Canvas::new(200, 20, PAPER);
            canvas.text(100, 2, "042", 2, align, INK);
            let dark: Vec<u32> = canvas
                .0
                .enumerate_pixels()
                .filter(|(_, _, p)| p.0[0] < 128)
                .map(|(x, _, _)| x)
                .collect();
            assert!(dark.len() > 100);
            (dark.iter().min().copied(), dark.iter().max().copied())
        };
        assert!(columns(Align::Left).0 >= Some(100) && columns(Align::Left).1 < Some(148));
        assert!(columns(Align::Right).0 >= Some(52) && columns(Align::Right).1 < Some(100));
        assert!(columns(Align::Centre).0 >= Some(76) && columns(Align::Centre).1 < Some(124));
    }
}
