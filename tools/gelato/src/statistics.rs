//! The statistics of a run in a machine-readable form, for `--statistics-json`. The schema is described in
//! `docs/gelato.md`.

use granita_base::{AtomicFile, FileError, Reporter, Severity};
use granita_render::{ErrorEstimate, ImageError};
use granita_session::{FrameRecord, Outcome};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The version of the schema. It changes when the meaning of a field changes or a field is removed. Fields may be added
/// without a change.
const SCHEMA: &str = "granita-statistics-1";

/// Returns the document.
pub(crate) fn document(outcome: &Outcome, scenes: &[String], reporter: &Reporter, status: u8) -> Value {
    json!({
        "schema": SCHEMA,
        "renderer": { "name": "Granita", "version": granita_base::VERSION },
        "scenes": scenes,
        "exit_status": status,
        "messages": {
            "errors": reporter.errors(),
            "warnings": reporter.count(Severity::Warning),
        },
        "peak_memory_bytes": peak_memory(),
        "frames": outcome.frames.iter().map(frame).collect::<Vec<_>>(),
        "images": names(&outcome.images),
        "files_read": names(&outcome.files_read),
    })
}

/// Writes the document. The file appears complete or not at all.
pub(crate) fn write(path: &Path, document: &Value) -> Result<(), FileError> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(format!("{document:#}\n").as_bytes()).map_err(|error| file.io_error(error))?;
    file.commit()
}

fn frame(record: &FrameRecord) -> Value {
    let cameras = record.cameras.iter().map(|(name, statistics)| {
        let mut fields = Map::new();
        fields.insert("name".into(), json!(&**name));
        fields.extend(statistics.counts().map(|(name, n)| (name.to_owned(), json!(n))));
        if let Some(reuse) = &statistics.reuse {
            let counts: Map<String, Value> =
                reuse.counts().map(|(name, n)| (name.to_owned(), json!(n))).into_iter().collect();
            fields.insert("reuse".to_owned(), counts.into());
        }
        if let Some(passes) = &statistics.passes {
            let error = passes.error.unwrap_or_default();
            let known = |value: f64| passes.error.map(|_| value);
            fields.insert(
                "passes".to_owned(),
                json!({
                    "passes": passes.passes,
                    "coarse": passes.coarse,
                    "finer": passes.finer,
                    "pixel_samples": passes.pixel_samples,
                    "samples": passes.samples,
                    "of_a_pixel": passes.mean_passes,
                    "error": known(error.error),
                    "error95": known(error.bound),
                    "bias": error.bias,
                    "blocks99": known(error.blocks_99),
                    "worst_block": passes.error.map(|error| {
                        let [x, y] = error.worst_at;
                        json!({ "error": error.worst_block, "x": x, "y": y })
                    }),
                    "causes": causes(&error),
                    "images": passes.images.iter().map(image).collect::<Vec<_>>(),
                    "requested": passes.requested,
                    "is_reached": passes.requested.map(|_| !passes.is_short && !passes.is_unsure),
                }),
            );
        }
        if let Some(done) = &statistics.denoised {
            fields.insert(
                "denoised".to_owned(),
                json!({
                    "library": done.library,
                    "features_seconds": done.features.as_secs_f64(),
                    "library_seconds": done.filter.as_secs_f64(),
                    "error": done.error.map(|error| error.error),
                    "error95": done.error.map(|error| error.bound),
                    "rejected": done.rejected.map(|error| error.error),
                }),
            );
        }
        let seconds: Map<String, Value> =
            statistics.seconds().map(|(name, s)| (name.to_owned(), json!(s))).into_iter().collect();
        fields.insert("seconds".into(), Value::Object(seconds));
        fields.insert("bucket_seconds".into(), json!(statistics.bucket_seconds));
        Value::Object(fields)
    });
    let shading: Map<String, Value> =
        record.shading.counts().map(|(name, n)| (name.to_owned(), json!(n))).into_iter().collect();
    json!({
        "complete": record.complete,
        "seconds": record.time.as_secs_f64(),
        "cameras": cameras.collect::<Vec<_>>(),
        "shading": shading,
        "inputs": { "read": record.inputs.read, "unread": record.inputs.unread },
        "images": names(&record.images),
    })
}

/// Returns the error of one of several images.
fn image(image: &ImageError) -> Value {
    let error = image.error.unwrap_or_default();
    let known = |value: f64| image.error.map(|_| value);
    json!({ "name": image.name, "error": known(error.error), "bias": error.bias, "causes": causes(&error) })
}

/// Returns the parts of the noise sources in an error, by their names.
fn causes(error: &ErrorEstimate) -> Map<String, Value> {
    error.causes().into_iter().map(|(source, part)| (source.name().to_owned(), json!(part))).collect()
}

fn names(paths: &[PathBuf]) -> Vec<String> {
    paths.iter().map(|p| p.to_string_lossy().into_owned()).collect()
}

/// Returns the peak memory of this process so far, in bytes; `None` where the system does not report it.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kb| kb * 1024)
}
