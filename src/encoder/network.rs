//! One network in an ONNX file: arrays in, an array out.
//!
//! The runtime is rten: pure Rust, 64 s of a cold build on two cores (tract-onnx: 293 s), and it runs
//! what is needed beside LPIPS, the int8 text towers of the BERT family. It stands behind the feature
//! `onnx`; a build without it says so when a network is asked for.

use std::path::Path;

use crate::error::Result;

/// An array, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// A network that is ready to run. Runs on threads of its own.
pub struct Network(runtime::Loaded);

impl Network {
    /// Reads a file; at least one input and one output.
    pub fn load(path: &Path) -> Result<Self> {
        runtime::Loaded::load(path).map(Self)
    }

    /// How many arrays go in.
    pub fn inputs(&self) -> usize {
        self.0.inputs()
    }

    /// The names of the arrays that go in, in the order of the file.
    pub fn input_names(&self) -> Vec<String> {
        self.0.input_names()
    }

    /// The names of the arrays that come out, in the order of the file.
    pub fn output_names(&self) -> Vec<String> {
        self.0.output_names()
    }

    /// The length that the file wants of the last dimension of an input, if it wants one.
    pub fn fixed_length(&self, input: usize) -> Option<usize> {
        self.0.fixed_length(input)
    }

    /// The first output for `inputs`, in the order of the file.
    pub fn run(&self, inputs: Vec<Tensor>) -> Result<Tensor> {
        self.0.run(inputs)
    }

    /// The output number `output` for one row of whole numbers an input, each an array of 1 × its
    /// length.
    pub fn run_rows(&self, inputs: Vec<Vec<i32>>, output: usize) -> Result<Tensor> {
        self.0.run_rows(inputs, output)
    }
}

#[cfg(feature = "onnx")]
mod runtime {
    use std::path::Path;
    use std::sync::Arc;

    use rten::{Dimension, Model, NodeId, RunOptions, ThreadPool, Value, ValueOrView};
    use rten_tensor::prelude::*;

    use super::Tensor;
    use crate::error::{Error, Result};

    pub(super) struct Loaded {
        name: String,
        model: Model,
        threads: Arc<ThreadPool>,
    }

    impl Loaded {
        pub(super) fn load(path: &Path) -> Result<Self> {
            let name = path.display().to_string();
            let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
            let model =
                Model::load(bytes).map_err(|e| Error::corrupt(name.as_str(), e.to_string()))?;
            if model.input_ids().is_empty() || model.output_ids().is_empty() {
                return Err(Error::corrupt(name, "the network has no input or no output"));
            }
            let cores = std::thread::available_parallelism().map_or(1, usize::from);
            Ok(Self { name, model, threads: Arc::new(ThreadPool::with_num_threads(cores)) })
        }

        pub(super) fn inputs(&self) -> usize {
            self.model.input_ids().len()
        }

        pub(super) fn input_names(&self) -> Vec<String> {
            self.names(self.model.input_ids())
        }

        pub(super) fn output_names(&self) -> Vec<String> {
            self.names(self.model.output_ids())
        }

        fn names(&self, ids: &[NodeId]) -> Vec<String> {
            let name = |id: &NodeId| self.model.node_info(*id)?.name().map(str::to_owned);
            ids.iter().map(|id| name(id).unwrap_or_default()).collect()
        }

        pub(super) fn fixed_length(&self, input: usize) -> Option<usize> {
            let id = self.model.input_ids().get(input)?;
            match self.model.node_info(*id)?.shape()?.last()? {
                Dimension::Fixed(length) => Some(*length),
                Dimension::Symbolic(_) => None,
            }
        }

        pub(super) fn run(&self, inputs: Vec<Tensor>) -> Result<Tensor> {
            let mut values = Vec::with_capacity(inputs.len());
            for Tensor { shape, values: numbers } in inputs {
                if shape.iter().product::<usize>() != numbers.len() {
                    let problem = format!("{} numbers are no array {shape:?}", numbers.len());
                    return Err(Error::Internal(problem));
                }
                values.push(Value::from(rten_tensor::Tensor::from_data(&shape, numbers)));
            }
            self.answer(values, 0)
        }

        pub(super) fn run_rows(&self, inputs: Vec<Vec<i32>>, output: usize) -> Result<Tensor> {
            let array = |row: Vec<i32>| rten_tensor::Tensor::from_data(&[1, row.len()], row);
            self.answer(inputs.into_iter().map(|row| Value::from(array(row))).collect(), output)
        }

        fn answer(&self, inputs: Vec<Value>, output: usize) -> Result<Tensor> {
            let wrong = |e: String| Error::invalid(self.name.as_str(), e);
            let ids = self.model.input_ids();
            if inputs.len() != ids.len() {
                let problem =
                    format!("the network takes {} arrays, not {}", ids.len(), inputs.len());
                return Err(wrong(problem));
            }
            let output = self.model.output_ids().get(output);
            let output = *output.ok_or_else(|| wrong("has no such output".into()))?;
            let inputs: Vec<(NodeId, ValueOrView<'_>)> =
                ids.iter().zip(inputs).map(|(id, value)| (*id, value.into())).collect();
            let options = RunOptions::default().with_thread_pool(Some(self.threads.clone()));
            let mut outputs = self
                .model
                .run(inputs, &[output], Some(options))
                .map_err(|e| wrong(e.to_string()))?;
            let output = outputs.pop().ok_or_else(|| wrong("gives nothing".into()))?;
            let array: rten_tensor::Tensor<f32> =
                output.try_into().map_err(|_| wrong("gives no f32 array".into()))?;
            Ok(Tensor { shape: array.shape().to_vec(), values: array.to_vec() })
        }
    }
}

#[cfg(not(feature = "onnx"))]
mod runtime {
    use std::path::Path;

    use super::Tensor;
    use crate::error::{Error, Result};

    /// Never made: loading says why.
    pub(super) enum Loaded {}

    impl Loaded {
        pub(super) fn load(path: &Path) -> Result<Self> {
            let path = path.display();
            let problem = format!("{path}: this build has no networks (feature `onnx`)");
            Err(Error::FailedPrecondition(problem))
        }

        pub(super) fn inputs(&self) -> usize {
            match *self {}
        }

        pub(super) fn input_names(&self) -> Vec<String> {
            match *self {}
        }

        pub(super) fn output_names(&self) -> Vec<String> {
            match *self {}
        }

        pub(super) fn fixed_length(&self, _input: usize) -> Option<usize> {
            match *self {}
        }

        pub(super) fn run(&self, _inputs: Vec<Tensor>) -> Result<Tensor> {
            match *self {}
        }

        pub(super) fn run_rows(&self, _inputs: Vec<Vec<i32>>, _output: usize) -> Result<Tensor> {
            match *self {}
        }
    }
}

#[cfg(feature = "onnx")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::onnx_bytes::mean_difference;

    fn load(bytes: &[u8]) -> Result<Network> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), bytes).expect("written");
        Network::load(file.path())
    }

    #[test]
    fn a_network_runs_on_any_size() {
        let network = load(&mean_difference()).expect("a network");
        assert_eq!(network.inputs(), 2);
        for n in [1, 7] {
            let ours = Tensor { shape: vec![1, 3, 2, n], values: vec![0.5; 6 * n] };
            let mut theirs = ours.clone();
            theirs.values[0] = -2.5;
            let output = network.run(vec![ours, theirs]).expect("it runs");
            assert_eq!(output.values.len(), 1, "{output:?}");
            assert!((output.values[0] - 3.0 / (6 * n) as f32).abs() < 1e-6, "{output:?}");
        }
    }

    #[test]
    fn what_is_no_network_or_does_not_fit_is_an_error() {
        let whole = mean_difference();
        for bytes in [&b"no network"[..], &[], &whole[..whole.len() / 2]] {
            assert!(load(bytes).is_err(), "{} bytes", bytes.len());
        }
        let error = Network::load(Path::new("absent.onnx")).err().expect("absent");
        assert!(error.to_string().contains("absent.onnx") && error.exit_code() == 2, "{error}");
        let network = load(&whole).expect("a network");
        let array = |n| Tensor { shape: vec![1, n], values: vec![0.0; n] };
        let error = network.run(vec![array(2)]).expect_err("one is missing").to_string();
        assert!(error.contains("2 arrays, not 1"), "{error}");
        assert!(network.run(vec![array(2), array(3)]).is_err(), "they do not fit each other");
    }
}
