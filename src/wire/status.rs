//! The one table between our outcomes and the codes of every transport.

use tonic::Code;

use crate::error::{Error, Status};

/// What a class of outcomes is called on each transport: one row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Codes {
    pub grpc: Code,
}

impl Codes {
    /// The row of a class.
    pub const fn of(status: Status) -> Self {
        let grpc = match status {
            Status::InvalidArgument => Code::InvalidArgument,
            Status::NotFound => Code::NotFound,
            Status::ResourceExhausted => Code::ResourceExhausted,
            Status::FailedPrecondition => Code::FailedPrecondition,
            Status::Unavailable => Code::Unavailable,
            Status::DataLoss => Code::DataLoss,
            Status::Internal => Code::Internal,
        };
        Self { grpc }
    }
}

/// A gRPC status with the error's own words.
pub fn status_from_error(error: &Error) -> tonic::Status {
    tonic::Status::new(Codes::of(error.status()).grpc, error.to_string())
}

/// The error of a gRPC status: what a client's caller sees.
pub fn error_from_status(status: &tonic::Status) -> Error {
    let message = status.message();
    match status.code() {
        Code::InvalidArgument | Code::OutOfRange => {
            let (field, problem) = message.split_once(": ").unwrap_or(("request", message));
            Error::invalid(field, problem)
        }
        Code::NotFound => Error::NotFound {
            what: message.strip_suffix(" not found").unwrap_or(message).to_owned(),
        },
        Code::ResourceExhausted => {
            let (what, limit) = message.split_once(": ").unwrap_or(("server", message));
            Error::ResourceExhausted { what: what.into(), limit: limit.into() }
        }
        Code::FailedPrecondition => Error::FailedPrecondition(message.into()),
        Code::Unavailable => Error::Unavailable(format!("the server is unavailable: {message}")),
        code => Error::Internal(format!("the server answered {code:?}: {message}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a caller of the client sees has the same class and words as what the server meant.
    #[test]
    fn errors_cross_the_wire_with_their_class_and_words() {
        for error in [
            Error::invalid("points_m[3].x", "NaN must be finite"),
            Error::NotFound { what: "map 'attic'".into() },
            Error::ResourceExhausted { what: "sensors".into(), limit: "64".into() },
            Error::FailedPrecondition("min_epoch: 4".into()),
        ] {
            let back = error_from_status(&status_from_error(&error));
            assert_eq!((back.status(), back.to_string()), (error.status(), error.to_string()));
        }
        for error in [
            Error::Unavailable("stopping".into()),
            Error::Internal("broken".into()),
            Error::corrupt("map", "checksum"),
        ] {
            let back = error_from_status(&status_from_error(&error)).to_string();
            assert!(back.contains(&error.to_string()), "{back}");
        }
    }
}
