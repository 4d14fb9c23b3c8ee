//! Codes as views hold them: all coefficients in halves or floats, or the largest alone (paper
//! Table IX, top-K).

use super::half::F16;
use super::products::{add_scaled, dot};
use crate::config::CodeForm;
use crate::geometry::simd::{InstructionSet, Kernel, LINE, Lanes};

/// Codes of some vertices.
#[derive(Debug, Clone)]
pub struct KeptCodes {
    set: InstructionSet,
    /// ‖c‖² of each code; 0 where there is none.
    squares: Vec<f32>,
    values: Values,
}

#[derive(Debug, Clone, PartialEq)]
enum Values {
    /// `width` numbers a code, zeros behind shorter ones.
    F16 {
        width: usize,
        values: Vec<F16>,
    },
    F32 {
        width: usize,
        values: Vec<f32>,
    },
    /// `terms` coefficients a code, and the numbers of their atoms.
    Terms {
        terms: usize,
        values: Vec<f32>,
        atoms: Vec<i16>,
    },
}

/// Codes as a file holds them; a column that the form does not have is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StoredCodes {
    pub halves: Vec<u16>,
    pub floats: Vec<f32>,
    pub atoms: Vec<i16>,
}

impl KeptCodes {
    /// `rows` codes that are nothing yet; `terms` is for [`CodeForm::TopK`].
    pub fn new(form: CodeForm, terms: usize, rows: usize) -> Self {
        let values = match form {
            CodeForm::F16 => Values::F16 { width: 0, values: Vec::new() },
            CodeForm::F32 => Values::F32 { width: 0, values: Vec::new() },
            CodeForm::TopK => Values::Terms {
                terms,
                values: vec![0.0; rows * terms],
                atoms: vec![0; rows * terms],
            },
        };
        Self { set: InstructionSet::detect(), squares: vec![0.0; rows], values }
    }

    /// Bytes of a code of `capacity` coefficients.
    pub fn bytes_of(form: CodeForm, terms: usize, capacity: usize) -> usize {
        size_of::<f32>()
            + match form {
                CodeForm::F16 => capacity * size_of::<F16>(),
                CodeForm::F32 => capacity * size_of::<f32>(),
                CodeForm::TopK => terms * (size_of::<f32>() + size_of::<i16>()),
            }
    }

    /// The number of codes, those that are nothing included.
    pub fn rows(&self) -> usize {
        self.squares.len()
    }

    /// Bytes held by codes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.squares[..])
            + match &self.values {
                Values::F16 { values, .. } => size_of_val(&values[..]),
                Values::F32 { values, .. } => size_of_val(&values[..]),
                Values::Terms { values, atoms, .. } => {
                    size_of_val(&values[..]) + size_of_val(&atoms[..])
                }
            }
    }

    /// ‖c‖², 0 where nothing was seen.
    #[inline]
    pub fn square(&self, row: usize) -> f32 {
        self.squares[row]
    }

    /// Writes a code.
    pub fn set(&mut self, row: usize, code: &[f32]) {
        let rows = self.squares.len();
        match &mut self.values {
            Values::F16 { width, values } => {
                widen(width, values, rows, code.len());
                let to = &mut values[row * *width..(row + 1) * *width];
                to.fill(F16::default());
                to.iter_mut().zip(code).for_each(|(to, x)| *to = F16::nearest(*x));
            }
            Values::F32 { width, values } => {
                widen(width, values, rows, code.len());
                let to = &mut values[row * *width..(row + 1) * *width];
                to.fill(0.0);
                to[..code.len()].copy_from_slice(code);
            }
            Values::Terms { terms, values, atoms } => {
                let range = row * *terms..(row + 1) * *terms;
                largest(code, &mut values[range.clone()], &mut atoms[range]);
            }
        }
        let mut kept = vec![0.0; code.len()];
        self.add_to(row, 1.0, &mut kept);
        self.squares[row] = dot(self.set, &kept, &kept);
    }

    /// Adds a code times `weight` to `out`, as far as both go.
    #[inline]
    pub fn add_to(&self, row: usize, weight: f32, out: &mut [f32]) {
        match &self.values {
            Values::F16 { width, values } => {
                let code = &values[row * width..(row + 1) * width];
                let len = code.len().min(out.len());
                self.set.run(AddHalves(weight, &code[..len], &mut out[..len]));
            }
            Values::F32 { width, values } => {
                add_scaled(self.set, weight, &values[row * width..(row + 1) * width], out);
            }
            Values::Terms { terms, values, atoms } => {
                let range = row * terms..(row + 1) * terms;
                for (x, atom) in values[range.clone()].iter().zip(&atoms[range]) {
                    if let Some(to) = out.get_mut(*atom as usize) {
                        *to += weight * x;
                    }
                }
            }
        }
    }

    /// Appends a code and its square to `to` as bytes: [`KeptCodes::bytes_of`] `width` coefficients.
    pub fn write_row(&self, row: usize, width: usize, to: &mut Vec<u8>) {
        to.extend(self.squares[row].to_le_bytes());
        let end = to.len() - size_of::<f32>() + self.row_bytes(width);
        match &self.values {
            Values::F16 { width: own, values } => {
                let code = values[row * own..(row + 1) * own].iter().take(width);
                to.extend(code.flat_map(|x| x.0.to_le_bytes()));
            }
            Values::F32 { width: own, values } => {
                let code = values[row * own..(row + 1) * own].iter().take(width);
                to.extend(code.flat_map(|x| x.to_le_bytes()));
            }
            Values::Terms { terms, values, atoms } => {
                let range = row * terms..(row + 1) * terms;
                to.extend(values[range.clone()].iter().flat_map(|x| x.to_le_bytes()));
                to.extend(atoms[range].iter().flat_map(|atom| atom.to_le_bytes()));
            }
        }
        to.resize(end, 0);
    }

    /// Takes up what [`KeptCodes::write_row`] wrote; `None` if its length is another.
    pub fn read_row(&mut self, row: usize, width: usize, bytes: &[u8]) -> Option<()> {
        (bytes.len() == self.row_bytes(width)).then_some(())?;
        let rows = self.squares.len();
        let (square, bytes) = bytes.split_first_chunk()?;
        self.squares[row] = f32::from_le_bytes(*square);
        match &mut self.values {
            Values::F16 { width: own, values } => {
                widen(own, values, rows, width);
                let (code, _) = bytes.as_chunks();
                let to = &mut values[row * *own..(row + 1) * *own];
                to.iter_mut().zip(code).for_each(|(to, x)| *to = F16(u16::from_le_bytes(*x)));
            }
            Values::F32 { width: own, values } => {
                widen(own, values, rows, width);
                let (code, _) = bytes.as_chunks();
                let to = &mut values[row * *own..(row + 1) * *own];
                to.iter_mut().zip(code).for_each(|(to, x)| *to = f32::from_le_bytes(*x));
            }
            Values::Terms { terms, values, atoms } => {
                let range = row * *terms..(row + 1) * *terms;
                let (floats, numbers) = bytes.split_at(range.len() * size_of::<f32>());
                let (floats, numbers) = (floats.as_chunks().0, numbers.as_chunks().0);
                let to = values[range.clone()].iter_mut();
                to.zip(floats).for_each(|(to, x)| *to = f32::from_le_bytes(*x));
                let to = atoms[range].iter_mut();
                to.zip(numbers).for_each(|(to, atom)| *to = i16::from_le_bytes(*atom));
            }
        }
        Some(())
    }

    fn row_bytes(&self, width: usize) -> usize {
        match &self.values {
            Values::F16 { .. } => Self::bytes_of(CodeForm::F16, 0, width),
            Values::F32 { .. } => Self::bytes_of(CodeForm::F32, 0, width),
            Values::Terms { terms, .. } => Self::bytes_of(CodeForm::TopK, *terms, width),
        }
    }

    /// Appends a code to `to`, in `width` coefficients where all of them are kept.
    pub fn store(&self, row: usize, width: usize, to: &mut StoredCodes) {
        match &self.values {
            Values::F16 { width: own, values } => {
                let end = to.halves.len() + width;
                to.halves
                    .extend(values[row * own..(row + 1) * own].iter().take(width).map(|x| x.0));
                to.halves.resize(end, 0);
            }
            Values::F32 { width: own, values } => {
                let end = to.floats.len() + width;
                to.floats.extend(values[row * own..(row + 1) * own].iter().take(width));
                to.floats.resize(end, 0.0);
            }
            Values::Terms { terms, values, atoms } => {
                to.floats.extend(&values[row * terms..(row + 1) * terms]);
                to.atoms.extend(&atoms[row * terms..(row + 1) * terms]);
            }
        }
    }
}

impl StoredCodes {
    /// Whether these are `rows` codes of `width` coefficients, or of `terms` where those are kept.
    pub fn fits(&self, form: CodeForm, terms: usize, rows: usize, width: usize) -> bool {
        let (all, some) = (rows * width, rows * terms);
        let lengths = match form {
            CodeForm::F16 => [all, 0, 0],
            CodeForm::F32 => [0, all, 0],
            CodeForm::TopK => [0, some, some],
        };
        lengths == [self.halves.len(), self.floats.len(), self.atoms.len()]
            && self.floats.iter().all(|x| x.is_finite())
            && self.halves.iter().all(|x| F16(*x).widen().is_finite())
            && self.atoms.iter().all(|atom| (0..width.max(1) as i32).contains(&i32::from(*atom)))
    }

    /// A code that [`KeptCodes::store`] wrote, written to `out`, which has `width` numbers.
    pub fn read(&self, form: CodeForm, terms: usize, row: usize, out: &mut [f32]) {
        let width = out.len();
        match form {
            CodeForm::F16 => {
                let halves = &self.halves[row * width..(row + 1) * width];
                out.iter_mut().zip(halves).for_each(|(to, x)| *to = F16(*x).widen());
            }
            CodeForm::F32 => out.copy_from_slice(&self.floats[row * width..(row + 1) * width]),
            CodeForm::TopK => {
                out.fill(0.0);
                for i in row * terms..(row + 1) * terms {
                    out[self.atoms[i] as usize] += self.floats[i];
                }
            }
        }
    }
}

/// Gives `rows` codes room for `len` coefficients.
fn widen<T: Copy + Default>(width: &mut usize, values: &mut Vec<T>, rows: usize, len: usize) {
    if len <= *width {
        return;
    }
    let mut wide = vec![T::default(); rows * len];
    if *width > 0 {
        for (to, from) in wide.chunks_exact_mut(len).zip(values.chunks_exact(*width)) {
            to[..*width].copy_from_slice(from);
        }
    }
    (*width, *values) = (len, wide);
}

/// The coefficients of the largest magnitude, of equal ones the first, without scaling them.
fn largest(code: &[f32], values: &mut [f32], atoms: &mut [i16]) {
    let mut order: Vec<i16> = (0..code.len() as i16).collect();
    let magnitude = |atom: i16| code[atom as usize].abs();
    if order.len() > values.len() {
        let larger = |a: &i16, b: &i16| magnitude(*b).total_cmp(&magnitude(*a)).then(a.cmp(b));
        order.select_nth_unstable_by(values.len() - 1, larger);
        order.truncate(values.len());
    }
    order.sort_unstable();
    values.fill(0.0);
    atoms.fill(0);
    for (i, atom) in order.into_iter().enumerate() {
        (values[i], atoms[i]) = (code[atom as usize], atom);
    }
}

/// `to += scale · from`, of equal lengths.
struct AddHalves<'a>(f32, &'a [F16], &'a mut [f32]);

impl Kernel for AddHalves<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self(scale, from, to) = self;
        let whole = from.len() - from.len() % LINE;
        let mut wide = [0.0; LINE];
        for at in (0..whole).step_by(LINE) {
            wide.iter_mut().zip(&from[at..at + LINE]).for_each(|(x, half)| *x = half.widen());
            for lane in (0..LINE).step_by(L::N) {
                L::load(&wide, lane)
                    .mul_add(L::splat(scale), L::load(to, at + lane))
                    .store(to, at + lane);
            }
        }
        to[whole..].iter_mut().zip(&from[whole..]).for_each(|(to, x)| *to += scale * x.widen());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMS: [CodeForm; 3] = [CodeForm::F16, CodeForm::F32, CodeForm::TopK];

    fn read(codes: &KeptCodes, row: usize, len: usize) -> Vec<f32> {
        let mut out = vec![0.0; len];
        codes.add_to(row, 1.0, &mut out);
        out
    }

    #[test]
    fn codes_come_back_and_may_grow() {
        let short: Vec<f32> = (0..20).map(|i| (i as f32 - 8.0) / 16.0).collect();
        let long: Vec<f32> = (0..37).map(|i| (i as f32 - 30.0) / 32.0).collect();
        for form in FORMS {
            let mut codes = KeptCodes::new(form, 64, 3);
            codes.set(0, &short);
            codes.set(2, &long);
            assert_eq!(read(&codes, 0, 20), short, "{form:?}");
            assert_eq!(read(&codes, 0, 40)[20..], [0.0; 20], "{form:?}");
            assert_eq!(read(&codes, 2, 37), long, "{form:?}");
            assert_eq!(read(&codes, 1, 37), [0.0; 37], "{form:?}");
            assert_eq!(codes.square(1), 0.0);
            let expected: f32 = short.iter().map(|x| x * x).sum();
            assert!((codes.square(0) - expected).abs() < 1e-5, "{form:?}");
            codes.set(2, &short);
            assert_eq!(read(&codes, 2, 37)[20..], [0.0; 17], "{form:?}");
            let mut sum = vec![1.0; 17];
            codes.add_to(0, 0.5, &mut sum);
            assert!(sum.iter().zip(&short).all(|(sum, x)| *sum == 1.0 + 0.5 * x), "{form:?}");
        }
    }

    #[test]
    fn the_largest_stay_as_they_were() {
        let mut codes = KeptCodes::new(CodeForm::TopK, 3, 3);
        codes.set(0, &[0.1, -0.9, 0.0, 0.5, -0.5, 0.5]);
        codes.set(2, &[0.25]);
        assert_eq!(read(&codes, 0, 6), [0.0, -0.9, 0.0, 0.5, -0.5, 0.0]);
        assert_eq!(read(&codes, 2, 2), [0.25, 0.0]);
        assert_eq!(codes.bytes(), 3 * (3 * 6 + 4));
    }

    #[test]
    fn stored_codes_are_the_same() {
        let code: Vec<f32> = (0..9).map(|i| (i as f32 - 4.0) / 8.0).collect();
        for form in FORMS {
            let mut codes = KeptCodes::new(form, 4, 2);
            codes.set(1, &code);
            let mut stored = StoredCodes::default();
            (0..2).for_each(|row| codes.store(row, 12, &mut stored));
            assert!(stored.fits(form, 4, 2, 12), "{form:?}");
            assert!(!stored.fits(form, 4, 3, 12) && !stored.fits(form, 4, 1, 12), "{form:?}");
            let mut out = vec![9.0; 12];
            stored.read(form, 4, 1, &mut out);
            assert_eq!(out, read(&codes, 1, 12), "{form:?}");
            stored.read(form, 4, 0, &mut out);
            assert_eq!(out, [0.0; 12], "{form:?}");
        }
        let mut damaged =
            StoredCodes { floats: vec![0.5; 2], atoms: vec![0, 12], ..StoredCodes::default() };
        assert!(!damaged.fits(CodeForm::TopK, 2, 1, 12));
        damaged.atoms[1] = -1;
        assert!(!damaged.fits(CodeForm::TopK, 2, 1, 12));
    }
}
