//! Errors as an HTTP client sees them: one JSON shape, whatever went wrong.

use std::fmt::Display;

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::error::Error;
use crate::wire::http_status;

/// Seconds after which a client may try again what failed for now.
const RETRY_AFTER_S: HeaderValue = HeaderValue::from_static("1");

/// Why there is no answer.
#[derive(Debug)]
pub(super) struct Refusal {
    status: StatusCode,
    code: &'static str,
    field: Option<String>,
    message: String,
}

/// What every error looks like.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ErrorReply<'a> {
    error: Problem<'a>,
}

/// What went wrong, for programs and for people.
#[derive(Debug, Serialize, ToSchema)]
struct Problem<'a> {
    /// The class of the failure, in the names of gRPC where it has one.
    #[schema(example = "INVALID_ARGUMENT")]
    code: &'a str,
    /// The input at fault, as in `points_m[3].x`; absent where none is.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    field: Option<&'a str>,
    /// What is wrong, with the limit that it broke.
    message: &'a str,
}

impl Refusal {
    /// A failure that only HTTP has.
    pub(super) fn new(status: StatusCode, code: &'static str, message: impl Into<String>) -> Self {
        Self { status, code, field: None, message: message.into() }
    }

    /// The same, about one input.
    pub(super) fn of(self, field: &str) -> Self {
        Self { message: format!("{field}: {}", self.message), field: Some(field.into()), ..self }
    }

    pub(super) fn no_route(path: &str) -> Self {
        let shown: String = path.chars().take(64).collect();
        Self::from(Error::NotFound { what: format!("path {shown}") })
    }

    pub(super) fn wrong_method(method: impl Display, path: &str) -> Self {
        let shown: String = path.chars().take(64).collect();
        let message = format!("{method} is not for {shown}; the allow header says what is");
        Self::new(StatusCode::METHOD_NOT_ALLOWED, "METHOD_NOT_ALLOWED", message)
    }

    pub(super) fn too_large(problem: impl Into<String>) -> Self {
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "PAYLOAD_TOO_LARGE", problem).of("body")
    }

    pub(super) fn too_slow(problem: impl Into<String>) -> Self {
        Self::new(StatusCode::REQUEST_TIMEOUT, "REQUEST_TIMEOUT", problem).of("body")
    }
}

impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        let (status, code) = http_status(error.status());
        let message = error.to_string();
        let field = match error {
            Error::InvalidArgument { field, .. } => Some(field),
            _ => None,
        };
        let status = StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        Self { status, code, field, message }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let problem =
            Problem { code: self.code, field: self.field.as_deref(), message: &self.message };
        // Strings always serialise.
        let body = serde_json::to_vec(&ErrorReply { error: problem }).unwrap_or_default();
        let mut response = (self.status, body).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, super::JSON);
        if matches!(self.status, StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE) {
            headers.insert(header::RETRY_AFTER, RETRY_AFTER_S);
        }
        response
    }
}
