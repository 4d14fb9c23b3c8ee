//! Every path and what answers it.

use std::sync::Arc;

use axum::Router;
use axum::routing::{get, post, put};

use super::{
    Edge, admin, dashboard, edits, events, images, language, maps, pieces, planner, points, probes,
    slices, snapshots, spheres, voxels, watches,
};

/// One line a path: for the router, for the counters, and for the tests of the document.
macro_rules! routes {
    ($($path:literal => $answer:expr,)*) => {
        pub(super) const ROUTES: [&str; [$($path),*].len()] = [$($path),*];

        pub(super) fn routed() -> Router<Arc<Edge>> {
            Router::new()$(.route($path, $answer))*
        }
    };
}

routes! {
    "/" => get(dashboard::root),
    "/healthz" => get(probes::healthy),
    "/livez" => get(probes::alive),
    "/readyz" => get(probes::ready),
    "/metrics" => get(probes::metrics),
    "/openapi.json" => get(probes::openapi),
    "/v1/config" => get(admin::config),
    "/v1/log" => put(admin::log),
    "/v1/maps" => get(maps::list),
    "/v1/maps/{map}" => get(maps::detail).put(maps::create).delete(maps::delete),
    "/v1/maps/{map}/stats" => get(maps::stats),
    "/v1/maps/{map}/reset" => post(maps::reset),
    "/v1/maps/{map}/clear" => post(edits::clear),
    "/v1/maps/{map}/stamp" => post(edits::stamp),
    "/v1/maps/{map}/query/points" => post(points::query),
    "/v1/maps/{map}/render" => post(images::render),
    "/v1/maps/{map}/query/text" => post(language::text),
    "/v1/maps/{map}/query/embedding" => post(language::embedding),
    "/v1/maps/{map}/classify" => post(language::classify),
    "/v1/maps/{map}/encoders" => get(language::encoders),
    "/v1/maps/{map}/query/spheres" => post(spheres::spheres),
    "/v1/maps/{map}/query/trajectories" => post(planner::trajectories),
    "/v1/maps/{map}/query/rays" => post(planner::rays),
    "/v1/maps/{map}/query/nearest" => post(planner::nearest),
    "/v1/maps/{map}/grid" => post(voxels::grid),
    "/v1/maps/{map}/slice.png" => get(slices::png),
    "/v1/maps/{map}/slice.json" => get(slices::json),
    "/v1/maps/{map}/slice.bin" => get(slices::bin),
    "/v1/maps/{map}/watch/region" => post(watches::region),
    "/v1/maps/{map}/watch/trajectories" => post(watches::trajectories),
    "/v1/maps/{map}/mesh/pieces" => get(pieces::pieces),
    "/v1/maps/{map}/mesh.ply" => get(pieces::ply),
    "/v1/maps/{map}/mesh.glb" => get(pieces::glb),
    "/v1/maps/{map}/snapshots" => get(snapshots::list).post(snapshots::create),
    "/v1/maps/{map}/snapshots/{name}" =>
        get(snapshots::download).put(snapshots::upload).delete(snapshots::delete),
    "/v1/maps/{map}/snapshots/{name}/restore" => post(snapshots::restore),
    "/v1/events" => get(events::events),
    "/assets/{file}" => get(dashboard::asset),
}
