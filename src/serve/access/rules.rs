//! Who may call what: one table for both protocols. A call of gRPC is a POST to its own path.

use std::sync::LazyLock;

use rustc_hash::FxHashMap;

use crate::config::Role;

/// What a caller must have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::serve) enum Needs {
    /// Nothing: probes, and pages that hold no map.
    Nothing,
    /// A key, whatever it is good for.
    AnyKey,
    Read,
    Ingest,
    Admin,
}

impl Needs {
    /// Whether a key of this role is enough.
    pub(super) fn is_met_by(self, role: Role) -> bool {
        match self {
            Self::Nothing | Self::AnyKey => true,
            Self::Read => matches!(role, Role::Read | Role::Admin),
            Self::Ingest => matches!(role, Role::Ingest | Role::Admin),
            Self::Admin => role == Role::Admin,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::AnyKey => "any",
            Self::Read => "read",
            Self::Ingest => "ingest",
            Self::Admin => "admin",
        }
    }
}

/// A row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::serve) struct Rule {
    pub(in crate::serve) method: &'static str,
    /// A path of gRPC, or a route of HTTP.
    pub(in crate::serve) path: &'static str,
    pub(in crate::serve) needs: Needs,
    /// Whether its answer goes on for as long as the client likes.
    pub(in crate::serve) is_stream: bool,
}

/// Of what is not in the table. A path that came without a row is not open by mistake.
pub(super) const OTHER: Rule = call("", Admin, "");

const fn call(method: &'static str, needs: Needs, path: &'static str) -> Rule {
    Rule { method, path, needs, is_stream: false }
}

const fn get(needs: Needs, path: &'static str) -> Rule {
    call("GET", needs, path)
}

const fn post(needs: Needs, path: &'static str) -> Rule {
    call("POST", needs, path)
}

const fn stream(needs: Needs, path: &'static str) -> Rule {
    Rule { is_stream: true, ..post(needs, path) }
}

use Needs::{Admin, AnyKey, Ingest, Nothing, Read};

/// Every route of HTTP with its methods, and every call of gRPC. A test holds it against the document of
/// the one and the descriptors of the other.
pub(in crate::serve) const RULES: &[Rule] = &[
    get(Nothing, "/"),
    get(Nothing, "/healthz"),
    get(Nothing, "/livez"),
    get(Nothing, "/readyz"),
    get(Nothing, "/openapi.json"),
    get(Read, "/metrics"),
    get(AnyKey, "/v1/maps"),
    get(AnyKey, "/v1/maps/{map}"),
    call("PUT", Admin, "/v1/maps/{map}"),
    call("DELETE", Admin, "/v1/maps/{map}"),
    get(AnyKey, "/v1/maps/{map}/stats"),
    post(Admin, "/v1/maps/{map}/reset"),
    post(Admin, "/v1/maps/{map}/clear"),
    post(Admin, "/v1/maps/{map}/stamp"),
    post(Read, "/v1/maps/{map}/query/points"),
    post(Read, "/v1/maps/{map}/render"),
    post(Read, "/v1/maps/{map}/query/text"),
    post(Read, "/v1/maps/{map}/query/embedding"),
    post(Read, "/v1/maps/{map}/classify"),
    get(AnyKey, "/v1/maps/{map}/encoders"),
    post(Read, "/v1/maps/{map}/query/spheres"),
    post(Read, "/v1/maps/{map}/query/trajectories"),
    post(Read, "/v1/maps/{map}/query/rays"),
    post(Read, "/v1/maps/{map}/query/nearest"),
    post(Read, "/v1/maps/{map}/grid"),
    get(Read, "/v1/maps/{map}/slice.png"),
    get(Read, "/v1/maps/{map}/slice.json"),
    get(Read, "/v1/maps/{map}/slice.bin"),
    stream(Read, "/v1/maps/{map}/watch/region"),
    stream(Read, "/v1/maps/{map}/watch/trajectories"),
    get(Admin, "/v1/maps/{map}/snapshots"),
    post(Admin, "/v1/maps/{map}/snapshots"),
    get(Admin, "/v1/maps/{map}/snapshots/{name}"),
    call("PUT", Admin, "/v1/maps/{map}/snapshots/{name}"),
    call("DELETE", Admin, "/v1/maps/{map}/snapshots/{name}"),
    post(Admin, "/v1/maps/{map}/snapshots/{name}/restore"),
    get(Read, "/v1/maps/{map}/mesh/pieces"),
    get(Read, "/v1/maps/{map}/mesh.ply"),
    get(Read, "/v1/maps/{map}/mesh.glb"),
    Rule { is_stream: true, ..get(Read, "/v1/events") },
    get(Nothing, "/assets/{file}"),
    get(Admin, "/v1/config"),
    call("PUT", Admin, "/v1/log"),
    stream(Ingest, "/orenx.v1.Ingest/StreamFrames"),
    post(Read, "/orenx.v1.Query/QueryPoints"),
    stream(Read, "/orenx.v1.Query/StreamQuery"),
    post(Read, "/orenx.v1.Render/Render"),
    stream(Read, "/orenx.v1.Render/RenderStream"),
    post(Read, "/orenx.v1.Language/QueryText"),
    post(Read, "/orenx.v1.Language/QueryEmbedding"),
    post(Read, "/orenx.v1.Language/Classify"),
    post(AnyKey, "/orenx.v1.Language/ListEncoders"),
    post(Read, "/orenx.v1.Planner/QuerySpheres"),
    post(Read, "/orenx.v1.Planner/CheckTrajectories"),
    post(Read, "/orenx.v1.Planner/CastRays"),
    post(Read, "/orenx.v1.Planner/GetGrid"),
    post(Read, "/orenx.v1.Planner/GetSlice"),
    post(Read, "/orenx.v1.Planner/FindNearest"),
    stream(Read, "/orenx.v1.Planner/WatchRegion"),
    stream(Read, "/orenx.v1.Planner/WatchTrajectory"),
    stream(Read, "/orenx.v1.Mirror/Subscribe"),
    post(AnyKey, "/orenx.v1.Maps/ListMaps"),
    post(AnyKey, "/orenx.v1.Maps/GetMap"),
    post(AnyKey, "/orenx.v1.Maps/GetMapStats"),
    post(Admin, "/orenx.v1.Maps/CreateMap"),
    post(Admin, "/orenx.v1.Maps/DeleteMap"),
    post(Admin, "/orenx.v1.Maps/ResetMap"),
    post(Admin, "/orenx.v1.Maps/ClearRegion"),
    post(Admin, "/orenx.v1.Maps/StampGeometry"),
    post(Admin, "/orenx.v1.Snapshots/Create"),
    post(Admin, "/orenx.v1.Snapshots/List"),
    post(Admin, "/orenx.v1.Snapshots/Delete"),
    stream(Admin, "/orenx.v1.Snapshots/Download"),
    stream(Admin, "/orenx.v1.Snapshots/Upload"),
    post(Admin, "/orenx.v1.Snapshots/Restore"),
    post(Admin, "/orenx.v1.Admin/SetLogLevel"),
    post(Admin, "/orenx.v1.Admin/GetConfig"),
    post(Nothing, "/grpc.health.v1.Health/Check"),
    post(Nothing, "/grpc.health.v1.Health/List"),
    stream(Nothing, "/grpc.health.v1.Health/Watch"),
    stream(AnyKey, "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo"),
    stream(AnyKey, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"),
];

/// The place of each row, by its path and method.
static PLACES: LazyLock<FxHashMap<(&str, &str), usize>> = LazyLock::new(|| {
    RULES.iter().enumerate().map(|(at, rule)| ((rule.path, rule.method), at)).collect()
});

/// Where the row of a call is in the table, if it has one. HEAD is GET without a body.
pub(in crate::serve) fn place(method: &str, path: &str) -> Option<usize> {
    let method = if method == "HEAD" { "GET" } else { method };
    PLACES.get(&(path, method)).copied()
}

#[cfg(test)]
mod tests {
    use prost::Message;
    use prost_types::FileDescriptorSet;

    use super::*;
    use crate::wire::DESCRIPTORS;

    /// A call that nobody gave a row is one of administrators, which is safe and seldom meant.
    #[test]
    fn every_call_of_grpc_has_its_row() {
        let mut calls = 0;
        for bytes in [DESCRIPTORS, tonic_health::pb::FILE_DESCRIPTOR_SET] {
            for file in FileDescriptorSet::decode(bytes).expect("our own").file {
                for service in &file.service {
                    for method in &service.method {
                        let (package, service) = (file.package(), service.name());
                        let path = format!("/{package}.{service}/{}", method.name());
                        let rule = place("POST", &path).map(|at| RULES[at]);
                        let rule = rule.unwrap_or_else(|| panic!("no row for {path} in RULES"));
                        let streams = method.client_streaming() || method.server_streaming();
                        assert_eq!(rule.is_stream, streams, "{path}");
                        calls += 1;
                    }
                }
            }
        }
        assert!(calls > 20, "{calls}");
    }

    #[test]
    fn roles_meet_what_they_are_for() {
        let met = |needs: Needs| {
            [Role::Ingest, Role::Read, Role::Admin].map(|role| needs.is_met_by(role))
        };
        assert_eq!(met(Nothing), [true; 3]);
        assert_eq!(met(AnyKey), [true; 3]);
        assert_eq!(met(Read), [false, true, true]);
        assert_eq!(met(Ingest), [true, false, true]);
        assert_eq!(met(Admin), [false, false, true]);
        assert_eq!(OTHER.needs, Admin);
        assert_eq!(place("HEAD", "/metrics"), place("GET", "/metrics"));
        assert_eq!(place("GET", "/v1/maps/{map}/reset"), None);
    }
}
