//! Files `.clf` of the Academy and the ASC (Common LUT Format, AMPAS S-2014-006): matrices, tables, ranges, exponents,
//! logarithms and decision lists, one after the other.

use crate::error::ColorError;
use crate::table::{Interpolation, Lut1d, Lut3d, MAX_EDGE, MAX_ENTRIES};
use crate::transform::{Cdl, Directed, LogParams, Negatives, Transform};
use roxmltree::{Document, Node};
use std::path::Path;
use std::sync::Arc;

struct Reader<'a> {
    document: &'a Document<'a>,
    path: &'a Path,
}

pub(super) fn read(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let document = Document::parse(text).map_err(|error| ColorError::Malformed {
        place: path.display().to_string(),
        what: error.to_string(),
    })?;
    let root = document.root_element();
    let reader = Reader { document: &document, path };
    if root.tag_name().name() != "ProcessList" {
        return Err(reader.malformed(root, "the file does not begin with a ProcessList"));
    }
    let mut found = Vec::new();
    for node in root.children().filter(Node::is_element) {
        match node.tag_name().name() {
            "Id" | "Description" | "InputDescriptor" | "OutputDescriptor" | "Info" => {}
            "Matrix" => reader.matrix(node, &mut found)?,
            "LUT1D" => reader.lut_1d(node, &mut found)?,
            "LUT3D" => reader.lut_3d(node, &mut found)?,
            "Range" => reader.range(node, &mut found)?,
            "Exponent" => reader.exponent(node, &mut found)?,
            "Log" => reader.log_params(node, &mut found)?,
            "ASC_CDL" => reader.cdl(node, &mut found)?,
            other => return Err(reader.unsupported(node, format!("the process {other}"))),
        }
    }
    Ok(found)
}

impl<'a> Reader<'a> {
    fn place(&self, node: Node<'_, '_>) -> String {
        format!("{}:{}", self.path.display(), self.document.text_pos_at(node.range().start).row)
    }

    fn malformed(&self, node: Node<'_, '_>, what: impl Into<String>) -> ColorError {
        ColorError::Malformed { place: self.place(node), what: what.into() }
    }

    fn unsupported(&self, node: Node<'_, '_>, what: impl Into<String>) -> ColorError {
        ColorError::Unsupported { place: self.place(node), what: what.into() }
    }

    fn child(&self, node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
        node.children().find(|child| child.tag_name().name() == name)
    }

    fn numbers(&self, node: Node<'_, '_>) -> Result<Vec<f64>, ColorError> {
        let words = node.text().unwrap_or_default().split_whitespace();
        words
            .map(|word| {
                let number = word.parse::<f64>().ok().filter(|v| v.is_finite());
                number.ok_or_else(|| self.malformed(node, format!("\"{word}\" is not a number")))
            })
            .collect()
    }

    fn attribute(&self, node: Node<'_, '_>, name: &str) -> Result<Option<f64>, ColorError> {
        let Some(word) = node.attribute(name) else { return Ok(None) };
        let number = word.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        number.map(Some).ok_or_else(|| self.malformed(node, format!("{name}=\"{word}\" is not a number")))
    }

    /// Returns the value that means 1 at the input or the output of a process.
    fn scale(&self, node: Node<'_, '_>, name: &str) -> Result<f64, ColorError> {
        match node.attribute(name) {
            Some("16f" | "32f") | None => Ok(1.0),
            Some("8i") => Ok(255.0),
            Some("10i") => Ok(1023.0),
            Some("12i") => Ok(4095.0),
            Some("16i") => Ok(65535.0),
            Some(other) => Err(self.malformed(node, format!("{name}=\"{other}\" is not known"))),
        }
    }

    /// Returns the numbers and the sizes of an array.
    fn array(&self, node: Node<'a, 'a>) -> Result<(Vec<usize>, Vec<f64>), ColorError> {
        let Some(array) = self.child(node, "Array") else {
            return Err(self.malformed(node, "there is no Array"));
        };
        let dim = array.attribute("dim").unwrap_or_default();
        let dim: Option<Vec<usize>> = dim.split_whitespace().map(|word| word.parse().ok()).collect();
        let dim =
            dim.filter(|dim| !dim.is_empty()).ok_or_else(|| self.malformed(array, "dim is not a list"))?;
        let product = dim.iter().try_fold(1_usize, |a, b| a.checked_mul(*b));
        let numbers = self.numbers(array)?;
        // The last size of a matrix is its number of channels.
        let matrix = dim.len() == 3 && dim[0].checked_mul(dim[1]) == Some(numbers.len());
        match matrix || product == Some(numbers.len()) {
            true => Ok((dim, numbers)),
            false => Err(self.malformed(array, format!("{} numbers, and dim names others", numbers.len()))),
        }
    }

    fn matrix(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        let (dim, numbers) = self.array(node)?;
        let scale = self.scale(node, "inBitDepth")? / self.scale(node, "outBitDepth")?;
        let offset_scale = 1.0 / self.scale(node, "outBitDepth")?;
        let (rows, columns) = (dim[0], *dim.get(1).unwrap_or(&0));
        if rows != 3 || !(3..=4).contains(&columns) {
            return Err(self.unsupported(node, format!("a matrix of {rows} x {columns}")));
        }
        let (mut matrix, mut offset) = ([0.0; 16], [0.0; 4]);
        matrix[15] = 1.0;
        for (i, row) in numbers.chunks_exact(columns).enumerate() {
            for j in 0..3 {
                matrix[4 * i + j] = row[j] * scale;
            }
            offset[i] = row.get(3).copied().unwrap_or(0.0) * offset_scale;
        }
        found.push(Directed::forward(Transform::Matrix(matrix, offset)));
        Ok(())
    }

    fn interpolation(&self, node: Node<'_, '_>) -> Interpolation {
        match node.attribute("interpolation") {
            Some("tetrahedral") => Interpolation::Tetrahedral,
            Some("nearest") => Interpolation::Nearest,
            _ => Interpolation::Linear,
        }
    }

    fn lut_1d(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        for name in ["halfDomain", "rawHalfs"] {
            if node.attribute(name).is_some_and(|value| value.eq_ignore_ascii_case("true")) {
                return Err(self.unsupported(node, name));
            }
        }
        let (dim, numbers) = self.array(node)?;
        let (n, components) = (dim[0], *dim.get(1).unwrap_or(&1));
        if n > MAX_ENTRIES {
            let (asked, max) = (n as u64, MAX_ENTRIES as u64);
            let what = "the entries of a table of one dimension";
            return Err(ColorError::Limit { place: self.place(node), what, asked, max });
        }
        if n < 2 || !(components == 1 || components == 3) {
            return Err(self.malformed(node, "a table has at least 2 entries of 1 or 3 numbers"));
        }
        let scale = self.scale(node, "outBitDepth")?;
        let table = numbers
            .chunks_exact(components)
            .map(|row| [0, 1, 2].map(|c| (row[c.min(components - 1)] / scale) as f32))
            .collect();
        let lut = Lut1d { table, interpolation: self.interpolation(node) };
        found.push(Directed::forward(Transform::Lut1d(Arc::new(lut))));
        Ok(())
    }

    fn lut_3d(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        let (dim, numbers) = self.array(node)?;
        let [edge, g, b, 3] = dim[..] else { return Err(self.malformed(node, "dim is not N N N 3")) };
        if edge > MAX_EDGE {
            let (asked, max) = (edge as u64, MAX_EDGE as u64);
            let what = "the edge of a table of three dimensions";
            return Err(ColorError::Limit { place: self.place(node), what, asked, max });
        }
        if edge < 2 || (g, b) != (edge, edge) {
            return Err(self.malformed(node, "the three edges are not equal and at least 2"));
        }
        let scale = self.scale(node, "outBitDepth")?;
        let table = numbers.chunks_exact(3).map(|row| [0, 1, 2].map(|c| (row[c] / scale) as f32)).collect();
        let lut = Lut3d { edge, table, interpolation: self.interpolation(node) };
        found.push(Directed::forward(Transform::Lut3d(Arc::new(lut))));
        Ok(())
    }

    fn range(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        let scales = [self.scale(node, "inBitDepth")?, self.scale(node, "outBitDepth")?];
        let mut values = [None; 4];
        for (value, (name, scale)) in values.iter_mut().zip([
            ("minInValue", scales[0]),
            ("maxInValue", scales[0]),
            ("minOutValue", scales[1]),
            ("maxOutValue", scales[1]),
        ]) {
            if let Some(child) = self.child(node, name) {
                *value = self.numbers(child)?.first().map(|v| v / scale);
            }
        }
        let clamp = !node.attribute("style").is_some_and(|style| style.eq_ignore_ascii_case("noClamp"));
        found.push(Directed::forward(Transform::Range(values, clamp)));
        Ok(())
    }

    /// Returns the channels that parameters are for: one, or red, green and blue.
    fn channels(&self, node: Node<'a, 'a>) -> Result<std::ops::Range<usize>, ColorError> {
        match node.attribute("channel") {
            None => Ok(0..3),
            Some("R") => Ok(0..1),
            Some("G") => Ok(1..2),
            Some("B") => Ok(2..3),
            Some(other) => Err(self.unsupported(node, format!("channel \"{other}\""))),
        }
    }

    fn exponent(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        let style = node.attribute("style").unwrap_or_default();
        let (mut gamma, mut offset) = ([1.0; 4], [0.0; 4]);
        for child in node.children().filter(|child| child.tag_name().name() == "ExponentParams") {
            for c in self.channels(child)? {
                gamma[c] = self.attribute(child, "exponent")?.unwrap_or(1.0);
                offset[c] = self.attribute(child, "offset")?.unwrap_or(0.0);
            }
        }
        let negatives = match style {
            s if s.ends_with("PassThruFwd") || s.ends_with("PassThruRev") => Negatives::Pass,
            s if s.contains("Mirror") => Negatives::Mirror,
            _ => Negatives::Clamp,
        };
        let transform = match style {
            s if s.starts_with("basic") => Transform::Exponent(gamma, negatives),
            s if s.starts_with("monCurve") => Transform::ExponentWithLinear(gamma, offset, negatives),
            other => return Err(self.unsupported(node, format!("the exponent \"{other}\""))),
        };
        let inverse = style.ends_with("Rev");
        found.push(Directed { inverse, ..Directed::forward(transform) });
        Ok(())
    }

    fn log_params(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        let style = node.attribute("style").unwrap_or_default();
        let (base, inverse, camera) = match style {
            "log10" => (10.0, false, false),
            "antiLog10" => (10.0, true, false),
            "log2" => (2.0, false, false),
            "antiLog2" => (2.0, true, false),
            "linToLog" => (10.0, false, false),
            "logToLin" => (10.0, true, false),
            "cameraLinToLog" => (10.0, false, true),
            "cameraLogToLin" => (10.0, true, true),
            other => return Err(self.unsupported(node, format!("the logarithm \"{other}\""))),
        };
        let mut log = LogParams::pure(base);
        let (mut breaks, mut slopes) = ([0.0; 3], [None; 3]);
        for child in node.children().filter(|child| child.tag_name().name() == "LogParams") {
            log.base = self.attribute(child, "base")?.unwrap_or(log.base);
            for c in self.channels(child)? {
                log.log_slope[c] = self.attribute(child, "logSideSlope")?.unwrap_or(1.0);
                log.log_offset[c] = self.attribute(child, "logSideOffset")?.unwrap_or(0.0);
                log.lin_slope[c] = self.attribute(child, "linSideSlope")?.unwrap_or(1.0);
                log.lin_offset[c] = self.attribute(child, "linSideOffset")?.unwrap_or(0.0);
                breaks[c] = self.attribute(child, "linSideBreak")?.unwrap_or(0.0);
                slopes[c] = self.attribute(child, "linearSlope")?;
            }
        }
        log.lin_break = camera.then_some(breaks);
        if let [Some(r), Some(g), Some(b)] = slopes {
            log.linear_slope = camera.then_some([r, g, b]);
        }
        found.push(Directed { inverse, ..Directed::forward(Transform::Log(log)) });
        Ok(())
    }

    fn cdl(&self, node: Node<'a, 'a>, found: &mut Vec<Directed>) -> Result<(), ColorError> {
        let style = node.attribute("style").unwrap_or("Fwd");
        let mut cdl = Cdl { clamp: !style.contains("NoClamp"), ..Cdl::default() };
        for child in node.descendants() {
            let three = || {
                let numbers = self.numbers(child)?;
                <[f64; 3]>::try_from(numbers).map_err(|_| self.malformed(child, "3 numbers are needed"))
            };
            match child.tag_name().name() {
                "Slope" => cdl.slope = three()?,
                "Offset" => cdl.offset = three()?,
                "Power" => cdl.power = three()?,
                "Saturation" => cdl.saturation = self.numbers(child)?.first().copied().unwrap_or(1.0),
                _ => {}
            }
        }
        let inverse = style.contains("Rev");
        found.push(Directed { inverse, ..Directed::forward(Transform::Cdl(cdl)) });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(body: &str) -> Result<Vec<Directed>, String> {
        let text = format!(
            "<ProcessList id=\"x\" compCLFversion=\"3\">\n<Description>d</Description>\n{body}\n</ProcessList>"
        );
        read(&text, Path::new("a.clf")).map_err(|error| error.to_string())
    }

    #[test]
    fn processes_are_read_in_order() {
        let got = of(r#"<Matrix inBitDepth="32f" outBitDepth="10i"><Array dim="3 3">1023 0 0 0 1023 0 0 0 1023</Array></Matrix>
<LUT1D inBitDepth="32f" outBitDepth="10i"><Array dim="2 1">0 1023</Array></LUT1D>
<LUT3D inBitDepth="32f" outBitDepth="32f" interpolation="tetrahedral"><Array dim="2 2 2 3">0 0 0 0 0 1 0 1 0 0 1 1 1 0 0 1 0 1 1 1 0 1 1 1</Array></LUT3D>
<Range><minInValue>0</minInValue><minOutValue>0</minOutValue></Range>
<Exponent style="monCurveRev"><ExponentParams exponent="2.4" offset="0.055"/></Exponent>
<Log style="cameraLogToLin"><LogParams base="2" logSideSlope="0.1" linSideBreak="0.01"/></Log>
<ASC_CDL style="FwdNoClamp"><SOPNode><Slope>1 2 3</Slope><Offset>0 0 0</Offset><Power>1 1 1</Power></SOPNode></ASC_CDL>"#).unwrap();
        assert_eq!(got.len(), 7);
        assert!(matches!(got[0].transform, Transform::Matrix(m, _) if m[0] == 1.0));
        assert!(matches!(&got[1].transform, Transform::Lut1d(t) if t.table[1] == [1.0; 3]));
        assert!(
            matches!(&got[2].transform, Transform::Lut3d(t) if t.interpolation == Interpolation::Tetrahedral)
        );
        assert!(matches!(got[3].transform, Transform::Range([Some(0.0), None, Some(0.0), None], true)));
        assert!(
            got[4].inverse
                && matches!(got[4].transform, Transform::ExponentWithLinear(g, _, _) if g[0] == 2.4)
        );
        assert!(
            got[5].inverse
                && matches!(got[5].transform, Transform::Log(l) if l.base == 2.0 && l.lin_break.is_some())
        );
        assert!(matches!(got[6].transform, Transform::Cdl(c) if !c.clamp && c.slope[2] == 3.0));
    }

    #[test]
    fn errors_name_the_line() {
        for (body, expected) in [
            ("<ACES/>", "a.clf:3: the process ACES is not supported"),
            ("<Matrix/>", "a.clf:3: there is no Array"),
            ("<LUT1D><Array dim=\"2 1\">0</Array></LUT1D>", "a.clf:3: 1 numbers, and dim names others"),
            (
                "<LUT3D><Array dim=\"1 1 1 3\">0 0 0</Array></LUT3D>",
                "a.clf:3: the three edges are not equal and at least 2",
            ),
            ("<LUT1D halfDomain=\"true\"/>", "a.clf:3: halfDomain is not supported"),
            ("<Log style=\"x\"/>", "a.clf:3: the logarithm \"x\" is not supported"),
        ] {
            assert_eq!(of(body).unwrap_err(), expected, "{body}");
        }
        assert!(read("<x/>", Path::new("a")).unwrap_err().to_string().contains("ProcessList"));
    }
}
