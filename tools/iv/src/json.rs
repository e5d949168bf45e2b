//! The output of `-info`, `-stats` and `-compare` as JSON, for scripts.
//!
//! JSON has no infinite numbers and no NaN. They become null.

use granita_base::{Param, ParamData};
use granita_image::{DeepSamples, PixelRect};
use granita_view::{Comparison, Image, Page, Statistics, statistics};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Returns everything about a file except its pixels. `deep` holds the samples of its deep images.
pub(crate) fn info(image: &Image, deep: &[Option<DeepSamples>]) -> Value {
    let of_page = |(of, deep): (&Arc<Page>, &Option<DeepSamples>)| {
        let mut all = page(of);
        if let Some(DeepSamples { total, most_per_pixel }) = deep {
            all["deepSamples"] = json!({ "total": total, "mostPerPixel": most_per_pixel });
        }
        all
    };
    file(image, image.pages.iter().zip(deep).map(of_page).collect())
}

/// Returns the statistics of all channels of a file.
///
/// # Errors
/// Returns an error when a part cannot be read.
pub(crate) fn stats(image: &Image) -> Result<Value, String> {
    let of_page = |page: &Page| -> Result<Value, String> {
        let spec = page.spec();
        let all = PixelRect::at(0, 0, spec.width, spec.height);
        let found = statistics(page, 0, all).map_err(|e| e.to_string())?;
        let channels = spec.channels.iter().zip(&found).map(|(name, s)| channel(name, s)).collect::<Vec<_>>();
        Ok(json!({ "width": spec.width, "height": spec.height, "channels": channels }))
    };
    let pages = image.pages.iter().map(|page| of_page(page)).collect::<Result<Vec<_>, _>>()?;
    Ok(file(image, pages))
}

/// Returns the difference of two images. `beyond` describes each value that is beyond its limit.
pub(crate) fn comparison(found: &Comparison, beyond: &[String]) -> Value {
    let channels: Vec<Value> = found
        .channels
        .iter()
        .map(|c| {
            json!({
                "name": c.name, "count": c.count, "mean": c.mean, "bias": c.bias, "rms": c.rms, "max": c.max,
                "max_at": c.max_at, "beyond": c.beyond, "broken": c.broken,
            })
        })
        .collect();
    json!({
        "width": found.size.0,
        "height": found.size.1,
        "channels": channels,
        "only_in_one": found.single,
        "pixels_beyond": found.pixels_beyond,
        "rms": found.rms,
        "psnr": found.psnr,
        "max": found.max,
        "flip": found.flip.map(|(mean, max)| json!({ "mean": mean, "max": max })),
        "decoded": found.decoded,
        "beyond": beyond,
    })
}

fn file(image: &Image, pages: Vec<Value>) -> Value {
    json!({ "file": image.path.display().to_string(), "format": image.format, "images": pages })
}

fn page(page: &Page) -> Value {
    let spec = page.spec();
    let levels: Vec<[u32; 2]> = page.specs.iter().map(|s| [s.width, s.height]).collect();
    let layers: Vec<String> = page.layers.iter().map(|l| l.title(&spec.channels)).collect();
    let attributes: Map<String, Value> =
        spec.attributes.iter().map(|p| (p.name.to_string(), attribute(p))).collect();
    json!({
        "name": page.name,
        "width": spec.width,
        "height": spec.height,
        "channels": spec.channels,
        "type": spec.pixel_type.word(),
        "tile": spec.is_tiled().then_some([spec.tile_width, spec.tile_height]),
        "levels": levels,
        "position": [spec.x, spec.y],
        "display_window": json!([spec.full_x, spec.full_y, spec.full_width, spec.full_height]),
        "kind": page.kind.word(),
        "face": page.layout.and_then(|l| l.face_size(spec)).map(|(size, _)| size),
        "layers": layers,
        "colors": page.colors.text,
        "attributes": attributes,
    })
}

/// Returns the value of an attribute; an array when it has several.
fn attribute(param: &Param) -> Value {
    let mut values = match &param.data {
        // Of a preview only the size is shown.
        ParamData::Int(v) if &*param.name == "preview" => v.iter().take(2).map(|v| json!(v)).collect(),
        ParamData::Int(v) => v.iter().map(|v| json!(v)).collect::<Vec<_>>(),
        ParamData::Float(v) => v.iter().map(|v| json!(v)).collect(),
        ParamData::String(v) => v.iter().map(|v| json!(**v)).collect(),
    };
    if values.len() == 1 { values.swap_remove(0) } else { Value::Array(values) }
}

fn channel(name: &str, s: &Statistics) -> Value {
    let value = |v: f64| (s.count > 0).then_some(v);
    json!({
        "name": name, "count": s.count, "min": value(s.min.into()), "max": value(s.max.into()), "mean": value(s.mean),
        "deviation": value(s.deviation()), "negative": s.negative, "nan": s.nan, "infinite": s.infinite,
    })
}
