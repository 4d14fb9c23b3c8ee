//! Errors as an HTTP client sees them: one JSON shape, whatever went wrong.

use std::fmt::Display;

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::error::Error;
use crate::wire::Codes;

/// How a client may say who it is.
const BEARER: HeaderValue = HeaderValue::from_static("Bearer");

/// Why there is no answer.
#[derive(Debug)]
pub(super) struct Refusal {
    status: StatusCode,
    code: &'static str,
    field: Option<String>,
    message: String,
    /// When a client may try again what failed for now, s.
    retry_after_s: u64,
}

/// What every error looks like.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ErrorReply {
    error: Problem,
}

/// What went wrong, for programs and for people.
#[derive(Debug, Serialize, ToSchema)]
struct Problem {
    /// The class of the failure, in the names of gRPC where it has one.
    #[schema(value_type = String, example = "INVALID_ARGUMENT")]
    code: &'static str,
    /// The input at fault, as in `points_m[3].x`; absent where none is.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = String, required = false)]
    field: Option<String>,
    /// What is wrong, with the limit that it broke.
    message: String,
}

impl Refusal {
    /// A failure that only HTTP has.
    pub(super) fn new(status: StatusCode, code: &'static str, message: impl Into<String>) -> Self {
        Self { status, code, field: None, message: message.into(), retry_after_s: 1 }
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
        let codes = Codes::of(error.status());
        let message = error.to_string();
        let field = error.field().map(str::to_owned);
        let status = StatusCode::from_u16(codes.http).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        // Whole seconds are all that the header knows.
        let retry_after_s =
            error.retry_after().map_or(1, |wait| wait.as_millis().div_ceil(1000) as u64);
        Self { status, code: codes.name, field, message, retry_after_s: retry_after_s.max(1) }
    }
}

impl Refusal {
    /// What it looks like.
    pub(super) fn json(&self) -> Vec<u8> {
        let Self { code, field, message, .. } = self;
        let (field, message) = (field.clone(), message.clone());
        // Strings always serialise.
        serde_json::to_vec(&ErrorReply { error: Problem { code, field, message } })
            .unwrap_or_default()
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let (status, retry_after_s) = (self.status, self.retry_after_s);
        let mut response = (status, self.json()).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, super::JSON);
        if matches!(status, StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE) {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(retry_after_s));
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, BEARER);
        }
        response
    }
}
