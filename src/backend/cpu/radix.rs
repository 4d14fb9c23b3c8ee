//! A stable radix sort of (key, payload) pairs: the order depends on the input alone.

const BITS: u32 = 11;
const BUCKETS: usize = 1 << BITS;

/// Sorts `pairs` by key, keeping equal keys in order; `scratch` is working space.
pub(super) fn sort_by_key(pairs: &mut Vec<(u32, u32)>, scratch: &mut Vec<(u32, u32)>) {
    let largest = pairs.iter().map(|(key, _)| *key).max().unwrap_or(0);
    scratch.clear();
    scratch.resize(pairs.len(), (0, 0));
    let mut shift = 0;
    while shift < 32 && largest >> shift != 0 {
        let digit = |key: u32| (key >> shift) as usize & (BUCKETS - 1);
        let mut starts = [0u32; BUCKETS];
        for (key, _) in pairs.iter() {
            starts[digit(*key)] += 1;
        }
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        for pair in pairs.iter() {
            let at = &mut starts[digit(pair.0)];
            scratch[*at as usize] = *pair;
            *at += 1;
        }
        std::mem::swap(pairs, scratch);
        shift += BITS;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::pcg4d;

    #[test]
    fn sorts_like_the_standard_stable_sort() {
        for mask in [0, 0xff, 0xfff_ffff, u32::MAX] {
            let mut pairs: Vec<(u32, u32)> =
                (0..5000).map(|i| (pcg4d([1, 2, 3, i])[0] & mask, i)).collect();
            let mut expected = pairs.clone();
            expected.sort_by_key(|(key, _)| *key);
            sort_by_key(&mut pairs, &mut Vec::new());
            assert!(pairs == expected, "mask {mask:x}");
        }
    }
}
