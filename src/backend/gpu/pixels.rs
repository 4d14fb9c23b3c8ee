//! Pixels of key frames on the GPU: each comes there once, and stays until nobody holds the key frame
//! or the room is needed.

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
    /// The call that last asked for them.
    asked: u64,
}

impl Pixels {
    /// Room for key frames of `room` pixels, in about `budget_bytes`.
    pub(super) fn new(gpu: &Gpu, room: usize, budget_bytes: usize) -> Result<Self> {
        let room = room.max(1);
        let pool = Pool::new(gpu, "key frame pixels", (room * size_of::<Pixel>()) as u64)?;
        Ok(Self { pool, budget_bytes, room, held: Vec::new(), calls: 0 })
    }

    /// Brings the pixels of frames to the GPU where they are not yet; returns where those of each
    /// frame begin.
    pub(super) fn place(&mut self, gpu: &Gpu, frames: &[&KeyFrame]) -> Result<Vec<u32>> {
        let longest = frames.iter().map(|frame| frame.pixels.len()).max().unwrap_or(0);
        if longest > self.room {
            *self = Self::new(gpu, longest, self.budget_bytes)?;
        }
        self.calls += 1;
        frames.iter().map(|frame| self.place_one(gpu, &frame.pixels)).collect()
    }

    fn place_one(&mut self, gpu: &Gpu, pixels: &Arc<[Pixel]>) -> Result<u32> {
        let known = self.held.iter().position(|held| Arc::ptr_eq(&held.pixels, pixels));
        let place = match known {
            Some(place) => place,
            None => {
                let place = self.free_place(gpu)?;
                let held = Held { pixels: pixels.clone(), asked: self.calls };
                match self.held.get_mut(place) {
                    Some(old) => *old = held,
                    None => self.held.push(held),
                }
                let offset = (place * self.room * size_of::<Pixel>()) as u64;
                gpu.queue.write_buffer(&self.pool.buffer, offset, bytemuck::cast_slice(pixels));
                place
            }
        };
        self.held[place].asked = self.calls;
        Ok((place * self.room) as u32)
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
            match (self.pool.grow(gpu, ahead), other) {
                (Ok(()), _) => {}
                (Err(Error::ResourceExhausted { .. }), Some(place)) => return Ok(place),
                (Err(error), _) => return Err(error),
            }
        }
        Ok(self.held.len())
    }
}
