//! The document that describes all of this: OpenAPI 3.1, made of the types that are sent.

use std::collections::BTreeMap;

use bytes::Bytes;
use serde_json::{Value, json};
use utoipa::openapi::security::{
    ApiKey, ApiKeyValue, HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme,
};
use utoipa::openapi::{ContentBuilder, Ref, RefOr, Response, ResponseBuilder};
use utoipa::{IntoParams, IntoResponses, Modify, OpenApi, ToSchema};

use super::super::access::{KEY_HEADER, Needs, rule};
use super::limits::Limits;
use super::{
    admin, dashboard, edits, events, images, language, maps, pieces, planner, points, probes,
    refusal, slices, snapshots, spheres, voxels, watches,
};

#[derive(OpenApi)]
#[openapi(
    info(description = "A map server for robots: signed distance, occupancy and color, asked over HTTP, \
        and what is where, in words. \
        Metres, seconds, world axes with z up; distance positive in free space. Every error is \
        JSON of one shape. A client that waits no longer than so many milliseconds says it in the \
        header `orenx-timeout-ms`, with any request. Every answer has a name in the header \
        `orenx-request-id`, the client's own if it sent a sane `x-request-id`."),
    servers((url = "/")),
    paths(
        dashboard::root, dashboard::asset, events::events, pieces::pieces, pieces::ply, pieces::glb,
        probes::healthy, probes::alive, probes::ready, probes::metrics,
        probes::openapi, admin::config, admin::log, maps::list, maps::detail, maps::create, maps::delete, maps::stats, maps::reset, edits::clear, edits::stamp, points::query,
        images::render, language::text, language::embedding, language::classify,
        language::encoders, spheres::spheres, planner::trajectories, planner::rays,
        planner::nearest, voxels::grid, slices::png, slices::json, slices::bin,
        watches::region, watches::trajectories, snapshots::list, snapshots::create,
        snapshots::download, snapshots::upload, snapshots::delete, snapshots::restore
    ),
    components(schemas(refusal::ErrorReply)),
    modifiers(&Keys),
    tags(
        (name = "server", description = "Who is there, and is it well?"),
        (name = "maps", description = "Which maps there are and how they are."),
        (name = "snapshots", description = "Maps as files."),
        (name = "query", description = "Questions about places."),
        (name = "planner", description = "Questions that planners ask."),
        (name = "render", description = "Images from places."),
        (name = "language", description = "Questions in words, or in an encoder's numbers.")
    )
)]
struct Document;

/// How a client says who it is, where the server wants to know.
struct Keys;

impl Modify for Keys {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let api_key = SecurityScheme::ApiKey(ApiKey::Header(ApiKeyValue::with_description(
            KEY_HEADER,
            "A key of the server's settings; its role says what it is good for.",
        )));
        let bearer =
            SecurityScheme::Http(HttpBuilder::new().scheme(HttpAuthScheme::Bearer).build());
        let components = document.components.get_or_insert_default();
        components.add_security_scheme("api_key", api_key);
        components.add_security_scheme("bearer", bearer);
        for (path, item) in &mut document.paths.paths {
            let operations = [
                ("GET", &mut item.get),
                ("POST", &mut item.post),
                ("PUT", &mut item.put),
                ("DELETE", &mut item.delete),
            ];
            for (method, operation) in operations {
                let Some(operation) = operation else { continue };
                let is_open = rule(method, path).needs == Needs::Nothing;
                let none: [String; 0] = [];
                // A server without keys asks for none.
                operation.security = Some(match is_open {
                    true => vec![],
                    false => vec![
                        SecurityRequirement::new("api_key", none.clone()),
                        SecurityRequirement::new("bearer", none),
                        SecurityRequirement::default(),
                    ],
                });
            }
        }
    }
}

/// The document of a server with these limits, as JSON.
pub(super) fn document(limits: &Limits) -> Bytes {
    let mut document = json!(Document::openapi());
    for request in ["PointsRequest", "ClassifyRequest"] {
        let points = format!("/components/schemas/{request}/properties/points_m");
        if let Some(points) = document.pointer_mut(&points) {
            points["maxItems"] = json!(limits.max_points);
        }
    }
    let either = [
        ("Text", ["prompts", "negatives"], ["encoder_id", "prompt_embeddings"]),
        ("ClassifyRequest", ["classes", "classes"], ["encoder_id", "class_embeddings"]),
    ];
    for (name, words, embeddings) in either {
        if let Some(schema) = document.pointer_mut(&format!("/components/schemas/{name}")) {
            schema["oneOf"] = words_or_embeddings(words, embeddings);
        }
    }
    let planners = ["SpheresRequest", "TrajectoriesRequest", "GridRequest"];
    for name in planners {
        if let Some(request) = document.pointer_mut(&format!("/components/schemas/{name}")) {
            request["allOf"] = json!([distance_needs_policy()]);
        }
    }
    if let Some(request) = document.pointer_mut("/components/schemas/PointsRequest") {
        // A distance for unknown points needs a policy that uses it, and a text score a text.
        request["allOf"] = json!([distance_needs_policy(), {
            "if": {
                "required": ["fields"],
                "properties": { "fields": { "type": "array", "contains": { "const": "text_score" } } }
            },
            "then": { "required": ["text"], "properties": { "text": { "type": "object" } } }
        }]);
    }
    Bytes::from(document.to_string())
}

/// A distance for unknown points needs a policy that uses it.
fn distance_needs_policy() -> Value {
    json!({
        "if": {
            "required": ["unknown_distance_m"],
            "properties": { "unknown_distance_m": { "type": "number" } }
        },
        "then": {
            "required": ["unknown_policy"],
            "properties": { "unknown_policy": { "enum": ["free", "occupied"] } }
        }
    })
}

/// Words, of which the first list is needed, or an encoder and its embeddings, never both.
fn words_or_embeddings(words: [&str; 2], embeddings: [&str; 2]) -> Value {
    let none = json!({ "type": "null" });
    let [encoder_id, numbers] = embeddings;
    json!([
        { "required": [words[0]],
          "properties": { words[0]: { "type": "array" }, encoder_id: none, numbers: none,
                          "negative_embeddings": none } },
        { "required": [encoder_id, numbers],
          "properties": { words[0]: none, words[1]: none, encoder_id: { "type": "string" },
                          numbers: { "type": "array" } } }
    ])
}

/// Numbers as they lie in memory, little-endian.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
pub(super) struct Raw(#[expect(dead_code, reason = "stands for a body in the document")] Vec<u8>);

/// The path's part that names a map.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "stands for a part of the path in the document")]
pub(super) struct MapPath {
    /// The map, as in "default".
    #[param(example = "default")]
    map: String,
}

/// The path's parts that name a snapshot.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "stands for parts of the path in the document")]
pub(super) struct SnapshotPath {
    /// The map, as in "default".
    #[param(example = "default")]
    map: String,
    /// The snapshot, as in "before-lunch".
    #[param(example = "before-lunch")]
    name: String,
}

/// What any path may answer instead.
pub(super) struct Any;

impl IntoResponses for Any {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[])
    }
}

/// What the paths of maps may answer instead.
pub(super) struct MapRefusals;

impl IntoResponses for MapRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[404])
    }
}

/// What may be answered instead of a change.
pub(super) struct ChangeRefusals;

impl IntoResponses for ChangeRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[404, 408, 409, 413])
    }
}

/// What may be answered instead of a change of the log.
pub(super) struct LogRefusals;

impl IntoResponses for LogRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[408, 409, 413])
    }
}

/// What may be answered instead of a snapshot.
pub(super) struct TransferRefusals;

impl IntoResponses for TransferRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[404, 409, 429])
    }
}

/// What may be answered instead of a change by hand.
pub(super) struct EditRefusals;

impl IntoResponses for EditRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[404, 408, 409, 413, 415, 429])
    }
}

/// What a question about points may be answered instead.
pub(super) struct PointRefusals;

impl IntoResponses for PointRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[404, 406, 408, 409, 413, 415])
    }
}

/// What a question for an image may be answered instead.
pub(super) struct ImageRefusals;

impl IntoResponses for ImageRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        refusals(&[404, 406, 408, 409, 413, 415])
    }
}

fn refusals(statuses: &[u16]) -> BTreeMap<String, RefOr<Response>> {
    let everywhere = [400, 401, 403, 429, 431, 500, 503, 504];
    let named = |status: &u16| {
        let content =
            ContentBuilder::new().schema(Some(Ref::from_schema_name("ErrorReply"))).build();
        let response = ResponseBuilder::new()
            .description(meaning(*status))
            .content("application/json", content)
            .build();
        (status.to_string(), RefOr::T(response))
    };
    everywhere.iter().chain(statuses).map(named).collect()
}

fn meaning(status: u16) -> &'static str {
    match status {
        400 => "INVALID_ARGUMENT: the field and the limit that it broke are in the message.",
        401 => "UNAUTHENTICATED: the server wants a key, and there is none, or none of its own.",
        403 => "PERMISSION_DENIED: the key is of another role, or a page of another site asks.",
        404 => "NOT_FOUND: no such map, no such snapshot, or no such robot in the map.",
        406 => "NOT_ACCEPTABLE: there is no answer in the form that `accept` asks for.",
        408 => "REQUEST_TIMEOUT: the body did not arrive in time.",
        409 => {
            "FAILED_PRECONDITION: the map is not as the request demands: not as new, of another encoder, \
             there already, not to be loaded."
        }
        413 => "PAYLOAD_TOO_LARGE: more than the largest question takes, by `server.max_points`.",
        415 => "UNSUPPORTED_MEDIA_TYPE: the body is none of the forms that are read here.",
        429 => "RESOURCE_EXHAUSTED: a bound was reached; try again after `retry-after` seconds.",
        431 => "HEADERS_TOO_LARGE.",
        503 => "UNAVAILABLE: the server is starting or stopping.",
        504 => "DEADLINE_EXCEEDED: no answer within `orenx-timeout-ms`.",
        _ => "INTERNAL: the server's own fault.",
    }
}
