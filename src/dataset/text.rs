//! The small text files of recordings: matrices, intrinsics and lists of numbers.

use std::path::Path;

use glam::DMat4;

use crate::error::{Error, Result};
use crate::geometry::{Intrinsics, Pose};

/// The 3×3 matrix beside a recording; an integer pixel is a pixel centre.
pub(super) const INTRINSICS_FILE: &str = "camera-intrinsics.txt";

/// A whole text file.
pub(super) fn read(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).map_err(|source| Error::io(path, source))
}

/// Exactly `N` numbers between white space; `place` names the file (and line) in errors.
pub(super) fn numbers<const N: usize>(place: &str, text: &str) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    let mut count = 0;
    for token in text.split_whitespace() {
        let value: f64 = token
            .parse()
            .map_err(|_| Error::invalid(place, format!("'{token}' must be a number")))?;
        if let Some(slot) = values.get_mut(count) {
            *slot = value;
        }
        count += 1;
    }
    if count != N {
        return Err(Error::invalid(place, format!("{count} numbers where {N} are needed")));
    }
    Ok(values)
}

/// A camera-to-world matrix of 16 numbers, row by row.
pub(super) fn pose(place: &str, text: &str) -> Result<Pose> {
    let rows = numbers::<16>(place, text)?;
    Pose::from_matrix(DMat4::from_cols_array(&rows).transpose()).map_err(|e| at(place, &e))
}

/// `camera-intrinsics.txt` of a folder for images of `size`; `None` if there is no such file.
pub(super) fn intrinsics(folder: &Path, size: (u32, u32)) -> Result<Option<Intrinsics>> {
    let path = folder.join(INTRINSICS_FILE);
    if !path.exists() {
        return Ok(None);
    }
    let place = path.display().to_string();
    let m = numbers::<9>(&place, &read(&path)?)?;
    let (fx, fy, cx, cy) = (m[0], m[4], m[2], m[5]);
    let inside = |c: f64, side: u32| c > 0.0 && c < f64::from(side);
    if !(fx > 1.0 && fx < 1e5 && fy > 1.0 && fy < 1e5 && inside(cx, size.0) && inside(cy, size.1)) {
        return Err(Error::invalid(
            place,
            format!("fx {fx}, fy {fy}, cx {cx}, cy {cy} do not fit {}x{} pixels", size.0, size.1),
        ));
    }
    Ok(Some(Intrinsics { fx, fy, cx, cy, width: size.0, height: size.1 }))
}

/// The same problem, with the place it came from.
pub(super) fn at(place: &str, error: &Error) -> Error {
    Error::invalid(place, error.to_string())
}
