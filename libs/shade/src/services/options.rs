//! Options of calls, one struct per kind of call.
//!
//! `N` stands for a number and `T` for a text. They are symbols of the code where a call is linked, and values
//! where it runs. Names are matched in [`OptionTable::set`] only.

use std::marker::PhantomData;

/// A table of options by name.
pub(crate) trait OptionTable<N, T>: Default {
    /// True when the option of this name takes a text, false when it takes a number; `None` when the call has no
    /// such option.
    fn takes_text(name: &str) -> Option<bool>;

    /// Sets the option of this name.
    fn set(&mut self, name: &str, number: Option<N>, text: Option<T>);

    /// Returns the names of all options. One that sets two options occurs twice.
    #[cfg(test)]
    fn names() -> Vec<&'static str>;
}

macro_rules! options {
    ($(
        $(#[$doc:meta])*
        $vis:vis struct $name:ident {
            numbers: $($number:ident $($number_name:literal)|+),*;
            texts: $($text:ident $($text_name:literal)|+),*;
        }
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[allow(missing_docs, reason = "fields carry the option names of the reference")]
        $vis struct $name<N, T> {
            $($vis $number: Option<N>,)*
            $($vis $text: Option<T>,)*
            /// Some calls have only one kind of options.
            kinds: PhantomData<(N, T)>,
        }

        impl<N, T> Default for $name<N, T> {
            fn default() -> Self {
                Self { $($number: None,)* $($text: None,)* kinds: PhantomData }
            }
        }

        impl<N: Copy, T: Copy> OptionTable<N, T> for $name<N, T> {
            fn takes_text(name: &str) -> Option<bool> {
                if false $(|| matches!(name, $($text_name)|+))* {
                    return Some(true);
                }
                (false $(|| matches!(name, $($number_name)|+))*).then_some(false)
            }

            fn set(&mut self, name: &str, number: Option<N>, text: Option<T>) {
                $(if matches!(name, $($number_name)|+) {
                    self.$number = number;
                })*
                $(if matches!(name, $($text_name)|+) {
                    self.$text = text;
                })*
                let _ = (number, text);
            }

            #[cfg(test)]
            fn names() -> Vec<&'static str> {
                vec![$($($number_name,)+)* $($($text_name,)+)*]
            }
        }

        impl<N: Copy, T: Copy> $name<N, T> {
            /// Visits all options in order, set or not.
            #[allow(dead_code, reason = "the renderer visits the options of some calls only")]
            $vis fn visit(&self, mut number: impl FnMut(Option<N>), mut text: impl FnMut(Option<T>)) {
                let _ = (&mut number, &mut text);
                $(number(self.$number);)*
                $(text(self.$text);)*
            }

            /// Returns the same options with other numbers and texts. A text that becomes `None` counts as not set.
            #[allow(dead_code, reason = "some calls look at each option by itself")]
            $vis fn map<M, U>(
                &self,
                number: impl Fn(N) -> M,
                text: impl Fn(T) -> Option<U>,
            ) -> $name<M, U> {
                let _ = (&number, &text);
                $name {
                    $($number: self.$number.map(&number),)*
                    $($text: self.$text.and_then(&text),)*
                    kinds: PhantomData,
                }
            }
        }
    )*};
}

options! {
    /// Options of `texture ()` and `texture3d ()` (reference 5.8.10).
    pub struct TextureOptions {
        numbers: sblur "blur" | "sblur", tblur "blur" | "tblur", swidth "width" | "swidth",
            twidth "width" | "twidth", firstchannel "firstchannel", fill "fill";
        texts: swrap "wrap" | "swrap", twrap "wrap" | "twrap";
    }

    /// Options of `environment ()` (reference 5.8.10). With `sample`, the map is not looked up along `r`, but in a
    /// direction sampled by its light. `sample` is the index of the sample.
    pub struct EnvironmentOptions {
        numbers: angle "angle", sblur "blur" | "sblur", tblur "blur" | "tblur", swidth "width" | "swidth",
            twidth "width" | "twidth", firstchannel "firstchannel", fill "fill", kr "Kr", radius "radius",
            samples "samples", sample "sample", bias "bias", maxhitdist "maxhitdist", shade "shade";
        texts: space "space", up "up";
    }

    /// Options of `shadow ()` (reference 5.8.10). `angle` is an extension.
    pub struct ShadowOptions {
        numbers: sblur "blur" | "sblur", tblur "blur" | "tblur", swidth "width" | "swidth",
            twidth "width" | "twidth", samples "samples", bias "bias", angle "angle";
        texts: ;
    }

    /// Options of the `trace` statement (reference 5.5.5).
    pub struct TraceOptions {
        numbers: bias "bias", maxhitdist "maxhitdist", shade "shade";
        texts: distribution "distribution";
    }

    /// Options of `indirect ()` and `occlusion ()` (reference 5.8.11).
    pub struct GatherOptions {
        numbers: samples "samples", adaptive "adaptive", maxerror "maxerror", maxpixeldist "maxpixeldist",
            bias "bias", maxhitdist "maxhitdist", falloff "falloff", falloffmode "falloffmode";
        texts: filename "filename", filemode "filemode", distribution "distribution";
    }

    /// Options of `spatialdbsave ()` (reference 5.8.13). `resolution` is an array of two numbers.
    pub(crate) struct SaveOptions {
        numbers: interpolate "interpolate", resolution "resolution", writefilterwidth "writefilterwidth";
        texts: filemode "filemode", filedataformat "filedataformat";
    }

    /// Options of `spatialdbquery ()` (reference 5.8.13).
    pub(crate) struct QueryOptions {
        numbers: maxerror "maxerror", maxdist "maxdist", minsamples "minsamples";
        texts: filter "filter", filemode "filemode";
    }

    /// Options of `subsurface ()` (reference 5.8.11). `model` is an extension.
    pub(crate) struct SubsurfaceOptions {
        numbers: scattering "scattering", absorption "absorption", eta "eta", maxsolidangle "maxsolidangle";
        texts: model "model";
    }

    /// Options of `aastep ()` (reference 5.8.7).
    pub(crate) struct StepOptions {
        numbers: width "width";
        texts: filter "filter";
    }
}

/// True for options of any call that looks up maps or traces rays. The compiler warns of such an option in another
/// call, which ignores it.
pub(crate) fn is_lookup_option(name: &str) -> bool {
    [
        <TextureOptions<(), ()> as OptionTable<(), ()>>::takes_text,
        <EnvironmentOptions<(), ()> as OptionTable<(), ()>>::takes_text,
        <ShadowOptions<(), ()> as OptionTable<(), ()>>::takes_text,
        <TraceOptions<(), ()> as OptionTable<(), ()>>::takes_text,
        <GatherOptions<(), ()> as OptionTable<(), ()>>::takes_text,
    ]
    .into_iter()
    .any(|takes_text| takes_text(name).is_some())
}

impl<N> TraceOptions<N, &str> {
    /// Returns the distribution of rays, which is "cosine" by default.
    pub fn spread(&self) -> &str {
        self.distribution.unwrap_or("cosine")
    }
}

impl<N> GatherOptions<N, &str> {
    /// Returns the distribution of rays, as [`TraceOptions::spread`].
    pub fn spread(&self) -> &str {
        self.distribution.unwrap_or("cosine")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_option_name_may_set_two_fields() {
        let mut o = TextureOptions::<u32, &str>::default();
        o.set("blur", Some(1), None);
        o.set("tblur", Some(2), None);
        o.set("wrap", None, Some("black"));
        assert_eq!(
            (o.sblur, o.tblur, o.swidth, o.swrap, o.twrap),
            (Some(1), Some(2), None, Some("black"), Some("black"))
        );
        let halved = o.map(|n| n as f32 / 2.0, |t| (t != "black").then_some(t));
        assert_eq!((halved.sblur, halved.tblur, halved.swrap), (Some(0.5), Some(1.0), None));
    }

    #[test]
    fn option_tables_know_their_names() {
        type Shadow = ShadowOptions<(), ()>;
        let takes_text = <Shadow as OptionTable<(), ()>>::takes_text;
        assert_eq!(["bias", "wrap", ""].map(takes_text), [Some(false), None, None]);
        assert!(is_lookup_option("wrap") && !is_lookup_option("bluur") && !is_lookup_option("eta"));
    }
}
