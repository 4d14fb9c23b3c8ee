//! The one table between our outcomes and the codes of every transport.

use serde::Deserialize;
use tonic::Code;
use tonic::metadata::MetadataValue;
use tonic_types::{ErrorDetails, StatusExt};

use crate::error::{Error, Status};

/// The trailer in which gRPC's own clients look when to try again, ms.
const PUSHBACK: &str = "grpc-retry-pushback-ms";

/// What a class of outcomes is called on each transport: one row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Codes {
    pub grpc: Code,
    pub http: u16,
    /// In the JSON of an HTTP error: gRPC's own name.
    pub name: &'static str,
}

impl Codes {
    /// The row of a class.
    pub const fn of(status: Status) -> Self {
        let (grpc, http, name) = match status {
            Status::InvalidArgument => (Code::InvalidArgument, 400, "INVALID_ARGUMENT"),
            Status::NotFound => (Code::NotFound, 404, "NOT_FOUND"),
            Status::ResourceExhausted => (Code::ResourceExhausted, 429, "RESOURCE_EXHAUSTED"),
            Status::Unauthenticated => (Code::Unauthenticated, 401, "UNAUTHENTICATED"),
            Status::PermissionDenied => (Code::PermissionDenied, 403, "PERMISSION_DENIED"),
            Status::FailedPrecondition => (Code::FailedPrecondition, 409, "FAILED_PRECONDITION"),
            Status::Unavailable => (Code::Unavailable, 503, "UNAVAILABLE"),
            Status::DeadlineExceeded => (Code::DeadlineExceeded, 504, "DEADLINE_EXCEEDED"),
            Status::DataLoss => (Code::DataLoss, 500, "DATA_LOSS"),
            Status::Internal => (Code::Internal, 500, "INTERNAL"),
        };
        Self { grpc, http, name }
    }
}

/// A gRPC status with the error's own words, and when to try again where that is known.
pub fn status_from_error(error: &Error) -> tonic::Status {
    let code = Codes::of(error.status()).grpc;
    let Some(retry_after) = error.retry_after() else {
        return tonic::Status::new(code, error.to_string());
    };
    let details = ErrorDetails::with_retry_info(Some(retry_after));
    let mut status = tonic::Status::with_error_details(code, error.to_string(), details);
    let ms = MetadataValue::from(retry_after.as_millis().max(1) as u64);
    status.metadata_mut().insert(PUSHBACK, ms);
    status
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
        Code::Unauthenticated => Error::Unauthenticated(message.into()),
        Code::PermissionDenied => Error::PermissionDenied(message.into()),
        Code::FailedPrecondition => Error::FailedPrecondition(message.into()),
        Code::DeadlineExceeded => Error::DeadlineExceeded(message.into()),
        Code::Unavailable => Error::Unavailable(format!("the server is unavailable: {message}")),
        code => Error::Internal(format!("the server answered {code:?}: {message}")),
    }
}

/// The JSON of an HTTP error.
#[derive(Debug, Deserialize)]
struct HttpError {
    error: HttpProblem,
}

#[derive(Debug, Deserialize)]
struct HttpProblem {
    code: String,
    field: Option<String>,
    message: String,
}

/// The error of an HTTP answer that is none: what a client's caller sees.
pub fn error_from_http(status: u16, body: &[u8]) -> Error {
    let Ok(HttpError { error }) = serde_json::from_slice(body) else {
        return Error::Internal(format!("the server answered HTTP {status}"));
    };
    let known = [
        Status::InvalidArgument,
        Status::NotFound,
        Status::ResourceExhausted,
        Status::Unauthenticated,
        Status::PermissionDenied,
        Status::FailedPrecondition,
        Status::Unavailable,
        Status::DeadlineExceeded,
    ];
    match known.into_iter().map(Codes::of).find(|codes| codes.name == error.code) {
        Some(codes) => error_from_status(&tonic::Status::new(codes.grpc, error.message)),
        // What only HTTP refuses, because of the request.
        None if (400..500).contains(&status) => {
            let field = error.field.unwrap_or_else(|| "request".into());
            let problem = error.message.strip_prefix(&format!("{field}: ")).map(str::to_owned);
            Error::invalid(field, problem.unwrap_or(error.message))
        }
        None => Error::Internal(format!("the server answered {}: {}", error.code, error.message)),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// What a caller of the client sees has the same class and words as what the server meant.
    #[test]
    fn errors_cross_the_wire_with_their_class_and_words() {
        for error in [
            Error::invalid("points_m[3].x", "NaN must be finite"),
            Error::NotFound { what: "map 'attic'".into() },
            Error::ResourceExhausted { what: "sensors".into(), limit: "64".into() },
            Error::Unauthenticated("no key".into()),
            Error::PermissionDenied("a key to read".into()),
            Error::FailedPrecondition("min_epoch: 4".into()),
            Error::DeadlineExceeded("no answer within 5ms".into()),
        ] {
            let codes = Codes::of(error.status());
            let body = serde_json::json!({
                "error": { "code": codes.name, "message": error.to_string() }
            });
            let back = error_from_http(codes.http, body.to_string().as_bytes());
            assert_eq!((back.status(), back.to_string()), (error.status(), error.to_string()));
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

    #[test]
    fn who_asks_too_often_is_told_when_to_ask_again() {
        let retry_after = Duration::from_millis(1500);
        let error =
            Error::Limited { what: "requests".into(), limit: "2 a second".into(), retry_after };
        let status = status_from_error(&error);
        assert_eq!(status.code(), Code::ResourceExhausted);
        let info = status.get_details_retry_info().expect("details");
        assert_eq!(info.retry_delay, Some(retry_after));
        assert_eq!(status.metadata().get(PUSHBACK).expect("a trailer"), "1500");
        assert_eq!(error_from_status(&status).to_string(), "requests: 2 a second");
    }

    #[test]
    fn what_only_http_says_is_understood_too() {
        let body =
            br#"{"error":{"code":"PAYLOAD_TOO_LARGE","field":"body","message":"body: 9; 8"}}"#;
        let error = error_from_http(413, body);
        assert_eq!(
            (error.status(), error.to_string()),
            (Status::InvalidArgument, "body: 9; 8".into())
        );
        assert_eq!(error_from_http(502, b"<html>").status(), Status::Internal);
    }

    #[test]
    fn classes_have_names_of_their_own_and_http_tells_faults_apart() {
        let theirs = [
            Status::InvalidArgument,
            Status::NotFound,
            Status::Unauthenticated,
            Status::PermissionDenied,
            Status::FailedPrecondition,
        ];
        assert!(theirs.iter().all(|s| (400..500).contains(&Codes::of(*s).http)));
        let ours = [Status::Unavailable, Status::DataLoss, Status::Internal];
        assert!(ours.iter().all(|s| Codes::of(*s).http >= 500));
    }
}
