//! Colour decision lists in XML: `.cc` (one correction), `.ccc` (a collection) and `.cdl` (ASC CDL 1.2).

use crate::error::ColorError;
use crate::transform::{Cdl, Directed, Transform};
use roxmltree::{Document, Node};
use std::path::Path;

pub(super) fn read(
    text: &str,
    path: &Path,
    id: Option<&str>,
    clamp: bool,
) -> Result<Vec<Directed>, ColorError> {
    let malformed = |what: String| ColorError::Malformed { place: path.display().to_string(), what };
    let document = Document::parse(text).map_err(|error| malformed(error.to_string()))?;
    let named = |node: &Node<'_, '_>| node.tag_name().name().eq_ignore_ascii_case("ColorCorrection");
    let corrections: Vec<_> = document.descendants().filter(named).collect();
    let found = match id {
        None | Some("") => corrections.first(),
        Some(id) => {
            let of_id = corrections.iter().find(|node| node.attribute("id") == Some(id));
            of_id.or_else(|| id.parse::<usize>().ok().and_then(|i| corrections.get(i)))
        }
    };
    let Some(node) = found else {
        return Err(malformed(match id {
            Some(id) => format!("there is no colour correction \"{id}\""),
            None => "there is no ColorCorrection".to_owned(),
        }));
    };
    let mut cdl = Cdl { clamp, ..Cdl::default() };
    for child in node.descendants().filter(Node::is_element) {
        let line = document.text_pos_at(child.range().start).row;
        let numbers = || -> Result<Vec<f64>, ColorError> {
            let words = child.text().unwrap_or_default().split_whitespace();
            let numbers: Option<Vec<f64>> =
                words.map(|word| word.parse().ok().filter(|v: &f64| v.is_finite())).collect();
            numbers.ok_or_else(|| ColorError::Malformed {
                place: format!("{}:{line}", path.display()),
                what: format!("{} is not a list of numbers", child.tag_name().name()),
            })
        };
        let three = || {
            <[f64; 3]>::try_from(numbers()?).map_err(|found| ColorError::Malformed {
                place: format!("{}:{line}", path.display()),
                what: format!("{} has {} numbers, and 3 are needed", child.tag_name().name(), found.len()),
            })
        };
        match child.tag_name().name() {
            "Slope" => cdl.slope = three()?,
            "Offset" => cdl.offset = three()?,
            "Power" => cdl.power = three()?,
            "Saturation" => cdl.saturation = numbers()?.first().copied().unwrap_or(1.0),
            _ => {}
        }
    }
    Ok(vec![Directed::forward(Transform::Cdl(cdl))])
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = r#"<ColorCorrectionCollection xmlns="urn:ASC:CDL:v1.01">
<ColorCorrection id="a"><SOPNode><Slope>1 1 1</Slope><Offset>0 0 0</Offset><Power>1 1 1</Power></SOPNode></ColorCorrection>
<ColorCorrection id="b"><SOPNode><Slope>2 1 1</Slope><Offset>0 .1 0</Offset><Power>1 1 2</Power></SOPNode>
<SatNode><Saturation>0.5</Saturation></SatNode></ColorCorrection></ColorCorrectionCollection>"#;

    #[test]
    fn corrections_are_found_by_name_and_by_number() {
        for id in ["b", "1"] {
            let got = read(TWO, Path::new("a.ccc"), Some(id), true).unwrap();
            let Transform::Cdl(cdl) = got[0].transform else { panic!() };
            assert_eq!((cdl.slope[0], cdl.offset[1], cdl.power[2], cdl.saturation), (2.0, 0.1, 2.0, 0.5));
            assert!(cdl.clamp);
        }
        assert!(
            matches!(read(TWO, Path::new("a"), None, false).unwrap()[0].transform, Transform::Cdl(c) if c.slope[0] == 1.0)
        );
    }

    #[test]
    fn errors_name_the_place() {
        let of = |text: &str, id| read(text, Path::new("a.ccc"), id, false).unwrap_err().to_string();
        assert_eq!(of(TWO, Some("c")), "a.ccc: there is no colour correction \"c\"");
        assert_eq!(of("<x/>", None), "a.ccc: there is no ColorCorrection");
        assert!(of("<x", None).starts_with("a.ccc: "));
        let few = TWO.replace("2 1 1", "2 1");
        assert_eq!(of(&few, Some("b")), "a.ccc:3: Slope has 2 numbers, and 3 are needed");
        assert_eq!(of(&TWO.replace("2 1 1", "2 1 x"), Some("b")), "a.ccc:3: Slope is not a list of numbers");
    }
}
