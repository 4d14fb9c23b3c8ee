//! Text into numbers, and the networks of others that this and LPIPS need.
//!
//! [`TextEncoder`] has three kinds: `static_table` (the mean of token vectors), `onnx_text` (a network)
//! and none at all, where callers send embeddings. `tokens` cuts text for the first two; `cache` keeps
//! what was embedded; `labels` makes features of images of classes.

mod cache;
#[cfg(test)]
mod household;
mod labels;
mod network;
#[cfg(feature = "onnx")]
#[cfg(test)]
pub(crate) mod onnx_bytes;
mod onnx_text;
mod static_table;
#[cfg(test)]
pub(crate) mod test_files;
mod text;
mod tokens;

pub use cache::CacheCounts;
pub use labels::features_of;
pub use network::{Network, Tensor};
pub use text::{MAX_TEXT_BYTES, MAX_TEXTS, TextEncoder};
