//! Transforms of configurations.

use super::Reader;
use crate::error::ColorError;
use crate::table::Interpolation;
use crate::transform::{
    Cdl, Directed, ExposureContrast, Fixed, LogParams, Named, Negatives, Scale, Transform,
};
use crate::yaml::Node;

impl Reader<'_> {
    /// Returns the transform of a node.
    pub(super) fn transform(&self, node: &Node) -> Result<Directed, ColorError> {
        let inverse = match self.text_of(node, "direction")? {
            None | Some("forward") => false,
            Some("inverse") => true,
            Some(other) => {
                return Err(self.malformed(node, format!("direction: {other}, not forward or inverse")));
            }
        };
        let tag = node.tag.strip_suffix("Transform").unwrap_or(&node.tag);
        let transform = match tag {
            "Allocation" => self.allocation(node)?,
            "Builtin" => Transform::Builtin(self.needed(node, "style")?),
            "CDL" => Transform::Cdl(Cdl {
                slope: self.three(node, "slope", 1.0)?,
                offset: self.three(node, "offset", 0.0)?,
                power: self.three(node, "power", 1.0)?,
                saturation: match self.number_of(node, "saturation")? {
                    Some(saturation) => saturation,
                    None => self.number_of(node, "sat")?.unwrap_or(1.0),
                },
                clamp: self.clamps(node, "style")?,
            }),
            "ColorSpace" => Transform::ColorSpace {
                src: self.needed(node, "src")?,
                dst: self.needed(node, "dst")?,
                data_bypass: self.flag(node, "data_bypass", true)?,
            },
            "DisplayView" => Transform::DisplayView {
                src: self.needed(node, "src")?,
                display: self.needed(node, "display")?,
                view: self.needed(node, "view")?,
            },
            "Exponent" => {
                Transform::Exponent(self.four(node, "value", 1.0)?, self.negatives(node, Negatives::Clamp)?)
            }
            "ExponentWithLinear" => Transform::ExponentWithLinear(
                self.four(node, "gamma", 1.0)?,
                self.four(node, "offset", 0.0)?,
                self.negatives(node, Negatives::Clamp)?,
            ),
            "ExposureContrast" => Transform::ExposureContrast(self.exposure_contrast(node)?),
            "File" => self.file(node)?,
            "FixedFunction" => self.fixed(node)?,
            "Group" => {
                let children = node.get("children").and_then(Node::list).unwrap_or_default();
                Transform::Group(
                    children.iter().map(|child| self.transform(child)).collect::<Result<_, _>>()?,
                )
            }
            "Log" => Transform::Log(LogParams::pure(self.number_of(node, "base")?.unwrap_or(2.0))),
            "LogAffine" => Transform::Log(self.log_params(node)?),
            "LogCamera" => {
                let log = self.log_params(node)?;
                if log.lin_break.is_none() {
                    return Err(self.malformed(node, "lin_side_break is missing"));
                }
                Transform::Log(log)
            }
            "Look" => Transform::Look {
                src: self.needed(node, "src")?,
                dst: self.needed(node, "dst")?,
                looks: self.text_of(node, "looks")?.unwrap_or_default().to_owned(),
                skip_conversion: self.flag(node, "skip_color_space_conversion", false)?,
            },
            "Matrix" => {
                let mut matrix = [0.0; 16];
                (matrix[0], matrix[5], matrix[10], matrix[15]) = (1.0, 1.0, 1.0, 1.0);
                if let Some(values) = node.get("matrix") {
                    matrix = self.exactly(values)?;
                }
                let offset = node.get("offset").map_or(Ok([0.0; 4]), |values| self.exactly(values))?;
                Transform::Matrix(matrix, offset)
            }
            "Range" => {
                let clamp = match self.text_of(node, "style")? {
                    None => true,
                    Some(style) if style.eq_ignore_ascii_case("clamp") => true,
                    Some(style) if style.eq_ignore_ascii_case("noclamp") => false,
                    Some(other) => {
                        return Err(self.malformed(node, format!("style: {other}, not Clamp or noClamp")));
                    }
                };
                let value = |snake: &str, camel: &str| match self.number_of(node, snake)? {
                    None => self.number_of(node, camel),
                    found => Ok(found),
                };
                let values = [
                    value("min_in_value", "minInValue")?,
                    value("max_in_value", "maxInValue")?,
                    value("min_out_value", "minOutValue")?,
                    value("max_out_value", "maxOutValue")?,
                ];
                Transform::Range(values, clamp)
            }
            "" => {
                return Err(self.malformed(node, "a transform without its kind, such as !<MatrixTransform>"));
            }
            _ => Transform::Unsupported(node.tag.clone()),
        };
        Ok(Directed { transform, inverse, line: node.line })
    }

    fn clamps(&self, node: &Node, key: &str) -> Result<bool, ColorError> {
        match self.text_of(node, key)? {
            None => Ok(false),
            Some(style) if style.eq_ignore_ascii_case("noclamp") => Ok(false),
            Some(style) if style.eq_ignore_ascii_case("asc") => Ok(true),
            Some(other) => Err(self.malformed(node, format!("{key}: {other}, not asc or noclamp"))),
        }
    }

    fn negatives(&self, node: &Node, default: Negatives) -> Result<Negatives, ColorError> {
        match self.text_of(node, "style")? {
            None => Ok(default),
            Some("clamp" | "linear") => Ok(Negatives::Clamp),
            Some("mirror") => Ok(Negatives::Mirror),
            Some("pass_thru") => Ok(Negatives::Pass),
            Some(other) => Err(self.malformed(node, format!("style: {other}, which is not known"))),
        }
    }

    fn log_params(&self, node: &Node) -> Result<LogParams, ColorError> {
        let optional = |key| match node.get(key) {
            None => Ok(None),
            Some(_) => self.three(node, key, 0.0).map(Some),
        };
        Ok(LogParams {
            base: self.number_of(node, "base")?.unwrap_or(2.0),
            log_slope: self.three(node, "log_side_slope", 1.0)?,
            log_offset: self.three(node, "log_side_offset", 0.0)?,
            lin_slope: self.three(node, "lin_side_slope", 1.0)?,
            lin_offset: self.three(node, "lin_side_offset", 0.0)?,
            lin_break: optional("lin_side_break")?,
            linear_slope: optional("linear_slope")?,
        })
    }

    /// Returns the transform of an allocation. It maps a range to [0, 1], or the logarithms of one.
    fn allocation(&self, node: &Node) -> Result<Transform, ColorError> {
        let values = node.get("vars").map_or(Ok(Vec::new()), |vars| self.numbers(vars))?;
        let fit = |low: f64, high: f64| {
            Directed::forward(Transform::Range([Some(low), Some(high), Some(0.0), Some(1.0)], false))
        };
        match self.text_of(node, "allocation")?.unwrap_or("uniform") {
            "uniform" => match values[..] {
                [] => Ok(Transform::Group(Vec::new())),
                [low, high] => Ok(Transform::Group(vec![fit(low, high)])),
                _ => Err(self.malformed(node, "vars has two numbers")),
            },
            "lg2" => {
                let (low, high) =
                    (values.first().copied().unwrap_or(-10.0), values.get(1).copied().unwrap_or(6.0));
                let lin_offset = [values.get(2).copied().unwrap_or(0.0); 3];
                let log = Transform::Log(LogParams { lin_offset, ..LogParams::pure(2.0) });
                Ok(Transform::Group(vec![Directed::forward(log), fit(low, high)]))
            }
            other => Err(self.malformed(node, format!("allocation: {other}, not uniform or lg2"))),
        }
    }

    fn exposure_contrast(&self, node: &Node) -> Result<ExposureContrast, ColorError> {
        let number = |key, default| self.number_of(node, key).map(|v| v.unwrap_or(default));
        Ok(ExposureContrast {
            scale: match self.text_of(node, "style")?.unwrap_or("linear") {
                "linear" => Scale::Linear,
                "video" => Scale::Video,
                "log" => Scale::Log,
                other => {
                    return Err(self.malformed(node, format!("style: {other}, not linear, video or log")));
                }
            },
            exposure: number("exposure", 0.0)?,
            contrast: number("contrast", 1.0)?,
            gamma: number("gamma", 1.0)?,
            pivot: number("pivot", 0.18)?,
            log_step: number("log_exposure_step", 0.088)?,
            log_mid_grey: number("log_midway_grey", 0.435)?,
        })
    }

    fn file(&self, node: &Node) -> Result<Transform, ColorError> {
        let interpolation = match self.text_of(node, "interpolation")? {
            None | Some("default" | "unknown") => None,
            Some("nearest") => Some(Interpolation::Nearest),
            Some("linear") => Some(Interpolation::Linear),
            Some("tetrahedral" | "best") => Some(Interpolation::Tetrahedral),
            Some("cubic") => Some(Interpolation::Linear),
            Some(other) => {
                return Err(self.malformed(node, format!("interpolation: {other}, which is not known")));
            }
        };
        Ok(Transform::File {
            src: self.needed(node, "src")?,
            id: self.text_of(node, "cccid")?.map(str::to_owned),
            interpolation,
            clamp: self.clamps(node, "cdl_style")?,
        })
    }

    fn fixed(&self, node: &Node) -> Result<Transform, ColorError> {
        let style = self.needed(node, "style")?;
        let params = node.get("params").map_or(Ok(Vec::new()), |params| self.numbers(params))?;
        Ok(match &*style.to_ascii_lowercase() {
            "aces_gamutcomp13" => match <[f64; 7]>::try_from(params) {
                Ok(params) => Transform::Fixed(Fixed::GamutCompression(params)),
                Err(params) => {
                    return Err(self.malformed(node, format!("{} params, and 7 are needed", params.len())));
                }
            },
            "aces_glow03" => Transform::Fixed(Fixed::Glow(0.075, 0.1)),
            "aces_glow10" => Transform::Fixed(Fixed::Glow(0.05, 0.08)),
            "aces_redmod10" => Transform::Fixed(Fixed::RedModifier),
            "aces_darktodim10" => Transform::Fixed(Fixed::DarkToDim),
            "rec2100_surround" => match params[..] {
                [gamma] if gamma > 0.0 => Transform::Fixed(Fixed::Surround(gamma)),
                _ => return Err(self.malformed(node, "params has one positive number")),
            },
            "xyz_to_xyy" => Transform::Fixed(Fixed::XyzToXyy),
            "xyz_to_uvy" => Transform::Fixed(Fixed::XyzToUvy),
            "lin_to_pq" => Transform::Named(Named::LinearToPq),
            _ => Transform::Unsupported(format!("FixedFunctionTransform of the style {style}")),
        })
    }
}
