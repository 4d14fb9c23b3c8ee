//! The one error type of the library and its one table of outcomes.
//!
//! Every transport turns [`Error::status`] into its own code, so that gRPC, HTTP and the command
//! line cannot disagree about what kind of failure happened.

use std::path::{Path, PathBuf};
use std::time::Duration;

/// What went wrong, in terms that a caller can act on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The caller's input is wrong; `field` names the input and `problem` the limit it broke.
    #[error("{field}: {problem}")]
    InvalidArgument { field: String, problem: String },
    /// A frame is wrong in a way that has a name of its own; the rest as in
    /// [`Error::InvalidArgument`].
    #[error("{field}: {problem}")]
    Frame { fault: Fault, field: String, problem: String },
    /// The named thing does not exist.
    #[error("{what} not found")]
    NotFound { what: String },
    /// A bound was reached; what was there before stays.
    #[error("{what}: {limit}")]
    ResourceExhausted { what: String, limit: String },
    /// A client asked too often or too much at once; the rest as in [`Error::ResourceExhausted`].
    #[error("{what}: {limit}")]
    Limited { what: String, limit: String, retry_after: Duration },
    /// Nobody knows who asks: there is no key, or one of nobody.
    #[error("{0}")]
    Unauthenticated(String),
    /// Who asks may not.
    #[error("{0}")]
    PermissionDenied(String),
    /// The request is well formed but the state does not allow it now.
    #[error("{0}")]
    FailedPrecondition(String),
    /// The server is starting or stopping.
    #[error("{0}")]
    Unavailable(String),
    /// There was no answer within the time that the caller gave.
    #[error("{0}")]
    DeadlineExceeded(String),
    /// Stored bytes are damaged or not ours.
    #[error("{what} is damaged: {problem}")]
    Corrupt { what: String, problem: String },
    /// The operating system refused a file.
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    /// The GPU went away or refused to go on; what it had not given back is lost.
    #[error("the GPU failed: {0}")]
    DeviceLost(String),
    /// A broken promise inside orenx.
    #[error("internal error: {0}")]
    Internal(String),
}

/// What is wrong with a frame, in terms that its sender's program can act on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A number of the pose is NaN or infinite.
    PoseNotFinite,
    /// The rotation is none, by more than what rounding explains.
    PoseNotRigid,
    /// An image has not the size of its camera.
    SizeMismatch,
    /// Depth is off by about a thousand.
    DepthUnit,
    /// No camera with this image has such intrinsics.
    Intrinsics,
    /// Older than what the same sensor sent before, by more than the limit.
    TooOld,
    /// The sequence number does not grow.
    OutOfOrder,
    /// Features of another encoder than the map's, or labels and nothing that could embed their names.
    Encoder,
}

/// The library's result.
pub type Result<T> = std::result::Result<T, Error>;

/// The outcome classes that every transport maps to its own codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    InvalidArgument,
    NotFound,
    ResourceExhausted,
    Unauthenticated,
    PermissionDenied,
    FailedPrecondition,
    Unavailable,
    DeadlineExceeded,
    DataLoss,
    Internal,
}

impl Error {
    /// Wrong input: the field and what it must satisfy.
    pub fn invalid(field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::InvalidArgument { field: field.into(), problem: problem.into() }
    }

    /// A frame's fault: the field and what it must satisfy.
    pub fn frame(fault: Fault, field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Frame { fault, field: field.into(), problem: problem.into() }
    }

    /// The input at fault, where one is.
    pub fn field(&self) -> Option<&str> {
        match self {
            Self::InvalidArgument { field, .. } | Self::Frame { field, .. } => Some(field),
            _ => None,
        }
    }

    /// When a client may try again, where that is known.
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Limited { retry_after, .. } => Some(*retry_after),
            _ => None,
        }
    }

    /// A file that the operating system refused.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_path_buf(), source }
    }

    /// Stored bytes that do not decode.
    pub fn corrupt(what: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Corrupt { what: what.into(), problem: problem.into() }
    }

    /// The outcome class.
    pub fn status(&self) -> Status {
        match self {
            Self::InvalidArgument { .. } | Self::Frame { .. } => Status::InvalidArgument,
            Self::NotFound { .. } => Status::NotFound,
            Self::ResourceExhausted { .. } | Self::Limited { .. } => Status::ResourceExhausted,
            Self::Unauthenticated(_) => Status::Unauthenticated,
            Self::PermissionDenied(_) => Status::PermissionDenied,
            Self::FailedPrecondition(_) => Status::FailedPrecondition,
            Self::Unavailable(_) => Status::Unavailable,
            Self::DeadlineExceeded(_) => Status::DeadlineExceeded,
            Self::Corrupt { .. } => Status::DataLoss,
            Self::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                Status::NotFound
            }
            Self::Io { .. } | Self::DeviceLost(_) | Self::Internal(_) => Status::Internal,
        }
    }

    /// The process exit code: 2 for bad arguments or input, 1 for anything else.
    pub fn exit_code(&self) -> u8 {
        match self.status() {
            Status::InvalidArgument | Status::NotFound | Status::DataLoss => 2,
            _ => 1,
        }
    }
}
