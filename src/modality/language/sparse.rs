//! Codes cut to their largest coefficients (paper Table IX, top-K).

/// The K largest coefficients of codes, with the numbers of their atoms: 6 bytes each.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseCodes {
    terms: usize,
    values: Vec<f32>,
    atoms: Vec<i16>,
}

impl SparseCodes {
    /// No codes yet, of at most `terms` coefficients each (at least one).
    pub fn new(terms: usize) -> Self {
        Self { terms: terms.max(1), values: Vec::new(), atoms: Vec::new() }
    }

    /// The number of codes.
    pub fn len(&self) -> usize {
        self.values.len() / self.terms
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice()) + size_of_val(self.atoms.as_slice())
    }

    /// Appends a code of at most [`super::MAX_CAPACITY`] coefficients, cut to those of the largest
    /// magnitude, of equal ones the first, without scaling them.
    pub fn push(&mut self, code: &[f32]) {
        let mut order: Vec<i16> = (0..code.len() as i16).collect();
        let magnitude = |atom: i16| code[atom as usize].abs();
        let larger = |a: &i16, b: &i16| magnitude(*b).total_cmp(&magnitude(*a)).then(a.cmp(b));
        if order.len() > self.terms {
            order.select_nth_unstable_by(self.terms - 1, larger);
            order.truncate(self.terms);
        }
        order.sort_unstable();
        self.values.extend(order.iter().map(|atom| code[*atom as usize]));
        self.atoms.extend(&order);
        let end = self.values.len().next_multiple_of(self.terms);
        // An empty code needs its place, too.
        let end = if order.is_empty() { end + self.terms } else { end };
        self.values.resize(end, 0.0);
        self.atoms.resize(end, 0);
    }

    /// The atoms and coefficients of a code that exists; zeros among them.
    pub fn terms(&self, row: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = row * self.terms..(row + 1) * self.terms;
        self.atoms[range.clone()]
            .iter()
            .map(|a| *a as usize)
            .zip(self.values[range].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_stay_as_they_were() {
        let mut codes = SparseCodes::new(3);
        codes.push(&[0.1, -0.9, 0.0, 0.5, -0.5, 0.5]);
        codes.push(&[]);
        codes.push(&[0.25]);
        let terms = |row| codes.terms(row).collect::<Vec<_>>();
        assert_eq!(terms(0), [(1, -0.9), (3, 0.5), (4, -0.5)]);
        assert_eq!(terms(1), [(0, 0.0); 3]);
        assert_eq!(terms(2), [(0, 0.25), (0, 0.0), (0, 0.0)]);
        assert_eq!((codes.len(), codes.bytes()), (3, 3 * 3 * 6));
    }
}
