//! Language: vision-language features of dimension d, kept as codes over one dictionary of atoms
//! that is learned online (paper, memory compression; algorithms.md §9).
//!
//! The atoms D are orthonormal columns, only ever appended. A feature v is kept as c = Dᵀv, so
//! that decoding is Dc, ‖Dc‖ = ‖c‖, and the cosine of a decoded feature with a text φ is
//! (Dᵀφ / ‖φ‖) · c / ‖c‖: text is scored among codes, and nothing is decoded. A code that is
//! shorter than the dictionary is a code whose last coefficients are zero, and stays right as the
//! dictionary grows.
//!
//! Nothing here has threads of its own. Sums are taken in an order that depends on the input alone,
//! so that the same features give the same atoms and codes, bit for bit, on one instruction set.

mod codes;
mod dictionary;
mod eigen;
mod features;
mod field;
mod growth;
mod half;
mod kept;
mod products;
mod query;
mod scatter;
#[cfg(test)]
mod tests;

pub use codes::Codes;
pub use dictionary::{Dictionary, DictionarySettings, DictionaryState, MAX_CAPACITY};
pub use features::UnitFeatures;
pub use field::{LanguageField, LanguageState};
pub use kept::{KeptCodes, StoredCodes};
pub use query::{NEGATIVES, Query, TEMPERATURE, cosine, relevancy, square};
