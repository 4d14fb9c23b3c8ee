//! Spans to a collector of OpenTelemetry, over OTLP.

use std::sync::OnceLock;

use opentelemetry::trace::TracerProvider;
use opentelemetry_otlp::{SpanExporter, WithExportConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tracing_subscriber::Layer;

use super::log::Writer;
use crate::error::{Error, Result};

/// What sends the spans: to be told when the process ends.
static PROVIDER: OnceLock<SdkTracerProvider> = OnceLock::new();

/// Sends each span that the log lets through to `endpoint`, as in `http://127.0.0.1:4317`. A collector
/// that is away is tried again; what does not fit into the queue meanwhile is dropped.
pub(super) fn layer(endpoint: &str) -> Result<Writer> {
    let exporter = SpanExporter::builder()
        .with_tonic()
        .with_endpoint(endpoint)
        .build()
        .map_err(|e| Error::invalid("log.otlp", e.to_string()))?;
    let provider = SdkTracerProvider::builder()
        .with_batch_exporter(exporter)
        .with_resource(Resource::builder().with_service_name(env!("CARGO_PKG_NAME")).build())
        .build();
    let tracer = provider.tracer(env!("CARGO_PKG_NAME"));
    let _ = PROVIDER.set(provider);
    Ok(tracing_opentelemetry::layer().with_tracer(tracer).boxed())
}

/// Sends what waits.
pub(super) fn flush() {
    if let Some(Err(error)) = PROVIDER.get().map(SdkTracerProvider::shutdown) {
        tracing::warn!(%error, "some spans were not sent");
    }
}
