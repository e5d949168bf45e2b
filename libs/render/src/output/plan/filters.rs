//! The pixel filters of images and their layers.

use super::Data;
use granita_base::{Filter, Location, Reporter, Severity};
use granita_gsl::ir::ValueType;
use granita_hider::film::{FilterSpec, PixelFilter};
use granita_scene::{Output, attr, attribute_row};

/// Returns "filter" and "filterwidth". By default depths are not blurred. They take the least depth of their own
/// pixel.
///
/// One of several layers may have a filter of its own ("filter:NAME"). Otherwise "filter" and "filterwidth" are for
/// colours, directions and numbers, while depths, positions and ids keep their defaults. The default of a position or
/// an id is "closest" in a layer and in a part of a file.
pub(super) fn filter_spec(output: &Output, data: &Data, is_one_of: bool, reporter: &Reporter) -> FilterSpec {
    if matches!(data, Data::Volume { .. }) {
        // The samples of a pixel of a volume shadow are combined in another way.
        return FilterSpec { filter: PixelFilter::Min, width: [1.0; 2] };
    }
    let depth = matches!(data, Data::Depth { .. });
    let has_no_mean = match data {
        Data::Variable { ty: ValueType::Point | ValueType::Matrix, .. } => true,
        Data::Variable { ty: ValueType::Float, names } => names.iter().all(|name| is_id(name)),
        _ => false,
    };
    // The reference defines the default of an image with a file of its own.
    let is_single_part = !is_one_of && !output.part().is_empty();
    let own = data.layer_name().filter(|_| is_one_of).map(|name| format!("filter:{name}"));
    let own = own.and_then(|name| output.params.string(&name).cloned());
    // Other words were reported.
    let own = own.filter(|word| filter_words().contains(&&**word));
    let (given, width) = match own {
        // A position has no mean with the background or with that of another surface.
        None if is_one_of && (depth || has_no_mean) => (has_no_mean.then(|| "closest".into()), None),
        None if is_single_part && has_no_mean && output.given(attr::FILTER).is_none() => {
            (Some("closest".into()), None)
        }
        None => (output.given(attr::FILTER), output.given(attr::FILTERWIDTH)),
        own => (own, output.given(attr::FILTERWIDTH).filter(|_| !depth)),
    };
    let filter = match given.as_deref() {
        Some("closest") => PixelFilter::Closest,
        None if depth => PixelFilter::Min,
        None => PixelFilter::Weighted(Filter::Gaussian),
        Some("min") if depth => PixelFilter::Min,
        Some("max") if depth => PixelFilter::Max,
        Some("average") if depth => PixelFilter::Average,
        // A mean over depths and infinity has no meaning, so every filter shape averages the finite depths.
        Some(_) if depth => PixelFilter::Average,
        Some(name) => PixelFilter::Weighted(Filter::from_word(name).unwrap_or_else(|| {
            reporter.once(
                &format!("filter {name}"),
                Severity::Warning,
                &Location::default(),
                format!("output \"{}\": unknown filter \"{name}\"; \"gaussian\" is used", output.name),
            );
            Filter::Gaussian
        })),
    };
    if filter == PixelFilter::Closest {
        return FilterSpec { filter, width: [1.0; 2] };
    }
    let default = if depth { [1.0; 2] } else { [2.0; 2] };
    let width = width.unwrap_or(default);
    let usable = |w: f32, default: f32| {
        if w.is_finite() && w > 0.0 && w <= 64.0 {
            return w;
        }
        reporter.once(
            &format!("filterwidth {}", output.name),
            Severity::Warning,
            &Location::default(),
            format!("output \"{}\": filter width {w} is outside 0 to 64; {default} is used", output.name),
        );
        default
    };
    // A filter narrower than the distance between samples would miss pixels.
    FilterSpec {
        filter,
        width: [usable(width[0], default[0]).max(0.25), usable(width[1], default[1]).max(0.25)],
    }
}

/// Returns what is wrong with "filter:NAME", which is for one of several layers.
pub(super) fn wrong_layer_filter(output: &Output, layer: &str) -> Option<String> {
    let names = || output.layers().filter_map(|data| data.split_whitespace().last());
    if output.layers().count() < 2 {
        return Some(format!("\"filter:{layer}\" is for one of several layers; \"filter\" is for all"));
    }
    if !names().any(|name| name == layer) {
        let known = names().collect::<Vec<_>>().join(", ");
        return Some(format!("\"filter:{layer}\": no layer has this name (there are: {known})"));
    }
    let asked = output.params.string(&format!("filter:{layer}"));
    match asked {
        Some(word) if filter_words().contains(&&**word) => None,
        _ => {
            let words = filter_words().join(", ");
            Some(format!("\"filter:{layer}\" is one of {words}; the filter of its kind is used"))
        }
    }
}

/// True for the name of a variable that holds the number of something: "id", or a name that ends with "_id", "Id" or
/// "ID".
fn is_id(name: &str) -> bool {
    name == "id" || ["_id", "Id", "ID"].iter().any(|end| name.ends_with(end))
}

/// Returns the names of pixel filters.
fn filter_words() -> &'static [&'static str] {
    attribute_row(attr::FILTER.name()).map_or(&[], |row| row.words())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_known_by_their_names() {
        assert!(["id", "object_id", "objectId", "primID"].iter().all(|name| is_id(name)));
        assert!(!["grid", "solid", "fluid", "idle", "Kd"].iter().any(|name| is_id(name)));
    }
}
