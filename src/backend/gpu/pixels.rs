//! Pixels of key frames on the GPU, with their colours where those are trained on: each comes there
//! once, and stays until nobody holds the key frame or the room is needed.

use std::sync::Arc;

use super::device::Gpu;
use super::pool::Pool;
use crate::error::{Error, Result};
use crate::train::{KeyFrame, Pixel};

/// Key frames that there is room for at least.
const LEAST: usize = 16;

/// A pool with room of one size for each key frame.
#[derive(Debug)]
pub(super) struct Pixels {
    pub(super) pool: Pool,
    /// Colours in the places of pixels, in bytes; of no meaning where a key frame has none.
    pub(super) colors: Option<Pool>,
    budget_bytes: usize,
    /// Pixels that a key frame has room for.
    room: usize,
    /// What lies in each place.
    held: Vec<Held>,
    /// Counts the calls of [`Self::place`].
    calls: u64,
}

#[derive(Debug)]
struct Held {
    pixels: Arc<[Pixel]>,
    /// The length of the longest direction, with z = 1 in camera axes.
    longest: f32,
    /// The call that last asked for them.
    asked: u64,
}

impl Pixels {
    /// Room for key frames of `room` pixels, in about `budget_bytes`.
    pub(super) fn new(gpu: &Gpu, room: usize, budget_bytes: usize, colored: bool) -> Result<Self> {
        let room = room.max(1);
        let pool = Pool::new(gpu, "key frame pixels", (room * size_of::<Pixel>()) as u64)?;
        let colors = || Pool::new(gpu, "key frame colours", room as u64 * 4);
        let colors = colored.then(colors).transpose()?;
        Ok(Self { pool, colors, budget_bytes, room, held: Vec::new(), calls: 0 })
    }

    pub(super) fn has_colors(&self) -> bool {
        self.colors.is_some()
    }

    /// The length of the longest direction of the frames that were placed last.
    pub(super) fn longest(&self) -> f32 {
        let last = self.held.iter().filter(|held| held.asked == self.calls);
        last.map(|held| held.longest).fold(1.0, f32::max)
    }

    /// Brings the pixels of frames to the GPU where they are not yet; returns where those of each
    /// frame begin.
    pub(super) fn place(&mut self, gpu: &Gpu, frames: &[&KeyFrame]) -> Result<Vec<u32>> {
        let longest = frames.iter().map(|frame| frame.pixels.len()).max().unwrap_or(0);
        if longest > self.room {
            *self = Self::new(gpu, longest, self.budget_bytes, self.has_colors())?;
        }
        self.calls += 1;
        frames.iter().map(|frame| self.place_one(gpu, frame)).collect()
    }

    fn place_one(&mut self, gpu: &Gpu, frame: &KeyFrame) -> Result<u32> {
        let pixels = &frame.pixels;
        let known = self.held.iter().position(|held| Arc::ptr_eq(&held.pixels, pixels));
        let place = match known {
            Some(place) => place,
            None => {
                let place = self.free_place(gpu)?;
                let lengths = pixels.iter().map(|&pixel| frame.direction(pixel).length());
                let longest = lengths.fold(1.0, f32::max);
                let held = Held { pixels: pixels.clone(), longest, asked: self.calls };
                match self.held.get_mut(place) {
                    Some(old) => *old = held,
                    None => self.held.push(held),
                }
                let offset = (place * self.room * size_of::<Pixel>()) as u64;
                gpu.queue.write_buffer(&self.pool.buffer, offset, bytemuck::cast_slice(pixels));
                if let Some(colors) = self.colors.as_ref().filter(|_| !frame.colors.is_empty()) {
                    let word = |[r, g, b]: &[u8; 3]| u32::from_le_bytes([*r, *g, *b, 0]);
                    let words: Vec<u32> = frame.colors.iter().map(word).collect();
                    let offset = (place * self.room * 4) as u64;
                    gpu.queue.write_buffer(&colors.buffer, offset, bytemuck::cast_slice(&words));
                }
                place
            }
        };
        self.held[place].asked = self.calls;
        Ok((place * self.room) as u32)
    }

    fn grow(&mut self, gpu: &Gpu, places: u64) -> Result<()> {
        // The colours first: places are counted by the pixels.
        self.colors.as_mut().map_or(Ok(()), |colors| colors.grow(gpu, places))?;
        self.pool.grow(gpu, places)
    }

    /// A place for another key frame: one that nobody else holds, then a new one, then the one that
    /// was not asked for for the longest time.
    fn free_place(&mut self, gpu: &Gpu) -> Result<usize> {
        let oldest = |given_up: bool| {
            let idle = self.held.iter().enumerate().filter(|(_, held)| {
                held.asked < self.calls && (!given_up || Arc::strong_count(&held.pixels) == 1)
            });
            idle.min_by_key(|(_, held)| held.asked).map(|(place, _)| place)
        };
        if let Some(place) = oldest(true) {
            return Ok(place);
        }
        let most = (self.budget_bytes / (self.room * size_of::<Pixel>())).max(LEAST);
        let other = oldest(false);
        if let Some(place) = other.filter(|_| self.held.len() >= most) {
            return Ok(place);
        }
        let places = self.held.len() as u64 + 1;
        if places > self.pool.capacity() {
            let ahead = (2 * places).min(most as u64).max(places);
            match (self.grow(gpu, ahead), other) {
                (Ok(()), _) => {}
                (Err(Error::ResourceExhausted { .. }), Some(place)) => return Ok(place),
                (Err(error), _) => return Err(error),
            }
        }
        Ok(self.held.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::gpu::Adapters;
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;

    /// Frames of seven pixels, each with depths of its own.
    fn frames(depths: std::ops::Range<u16>) -> Vec<KeyFrame> {
        let seen = Synthetic::room(2).with_width(16).load(0, false).expect("a frame");
        let pixel = |z: u16, u: u16| Pixel { u, v: 1, z: f32::from(z) };
        let frame = |z: u16| {
            let mut frame = KeyFrame::new(&seen, None, 16, 0.1, None);
            frame.pixels = (0..7).map(|u| pixel(z, u)).collect();
            frame
        };
        depths.map(frame).collect()
    }

    #[test]
    fn pixels_come_once_and_give_way_when_nobody_holds_them() {
        let gpu = Gpu::open(Adapters::Any).expect("an adapter");
        let mut pixels = Pixels::new(&gpu, 7, 0, false).expect("room");
        let mut all = frames(0..LEAST as u16 + 4);
        let mut placed = Vec::new();
        for pair in all.chunks(2) {
            let window: Vec<&KeyFrame> = pair.iter().collect();
            placed.extend(pixels.place(&gpu, &window).expect("room"));
            // A copy is the same key frame.
            let again = pixels.place(&gpu, &[&pair[1].clone()]).expect("room");
            assert_eq!(placed.last(), again.last());
        }
        // The room is full: the oldest two pairs gave way to the last two.
        assert_eq!((pixels.held.len(), pixels.pool.capacity()), (LEAST, LEAST as u64));
        let there = |pixels: &Pixels, place: u32| -> Vec<f32> {
            let words = gpu.read::<[u32; 2]>(&pixels.pool.buffer, pixels.room * pixels.held.len());
            let words = words.expect("pixels");
            words[place as usize..][..7].iter().map(|p| f32::from_bits(p[1])).collect()
        };
        for (i, &place) in placed.iter().enumerate().skip(4) {
            assert_eq!(there(&pixels, place), [i as f32; 7], "key frame {i}");
        }
        // One that is given up gives its place, though others are older.
        let given_up = placed[18];
        all.remove(18);
        let next = frames(50..51);
        assert_eq!(pixels.place(&gpu, &[&next[0]]).expect("room"), [given_up]);
        assert_eq!(there(&pixels, given_up), [50.0; 7]);
        // A larger one makes all places larger.
        let mut large = frames(60..61);
        large[0].pixels = [&large[0].pixels[..], &large[0].pixels[..]].concat().into();
        let window = [&next[0], &large[0]];
        assert_eq!(pixels.place(&gpu, &window).expect("room"), [0, 14]);
        assert_eq!((there(&pixels, 0), there(&pixels, 14)), (vec![50.0; 7], vec![60.0; 7]));
    }
}
