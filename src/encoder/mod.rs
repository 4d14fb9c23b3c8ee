//! Networks that others trained, from ONNX files.

mod network;
#[cfg(feature = "onnx")]
#[cfg(test)]
pub(crate) mod onnx_bytes;

pub use network::{Network, Tensor};
