//! Networks that others trained, from ONNX files.

mod network;
#[cfg(all(test, feature = "onnx"))]
pub(crate) mod onnx_bytes;

pub use network::{Network, Tensor};
