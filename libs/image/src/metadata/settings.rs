//! The settings of a rendered image (attributes whose names begin with [`PREFIX`]) in a packet of XMP, for formats that
//! have no texts of any name.
//!
//! A packet of XMP is a text of XML. Settings are one element in it, a bag of texts `NAME=VALUE` in the namespace
//! `urn:granita:settings:1`. [`packet`] writes this element in one form, and [`take`] recognises that form alone. In a
//! packet that another program wrote again it is left as it is.

use granita_base::{BaseType, Param, ParamData, ParamType, Params};

/// The beginning of the names of settings.
pub const PREFIX: &str = "granita/";

const OPEN: &str =
    "<rdf:Description rdf:about=\"\" xmlns:granita=\"urn:granita:settings:1\"><granita:settings><rdf:Bag>";
const CLOSE: &str = "</rdf:Bag></granita:settings></rdf:Description>";
const ITEM: (&str, &str) = ("<rdf:li>", "</rdf:li>");

/// The text around settings where there is no packet yet.
const PACKET: (&str, &str) = (
    "<?xpacket begin=\"\u{feff}\" id=\"W5M0MpCehiHzreSzNTczkc9d\"?><x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\
     <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">",
    "</rdf:RDF></x:xmpmeta><?xpacket end=\"w\"?>",
);

/// Returns the packet of XMP of an image: the attribute `XMP` with the settings in it, or a packet that has them alone.
/// `None` when there are neither. A packet that does not end as the specification says is returned as it is.
pub fn packet(attributes: &Params) -> Option<String> {
    let given = given(attributes);
    let mut items = String::new();
    for param in attributes.iter().filter(|param| param.name.starts_with(PREFIX)) {
        if let Some(value) = attributes.string(&param.name) {
            let text = escaped(&format!("{}={value}", &param.name[PREFIX.len()..]));
            items.extend([ITEM.0, &text, ITEM.1]);
        }
    }
    if items.is_empty() {
        return given;
    }
    let settings = [OPEN, &items, CLOSE].concat();
    let Some(given) = given else { return Some([PACKET.0, &settings, PACKET.1].concat()) };
    match given.rfind("</rdf:RDF>") {
        Some(end) => Some([&given[..end], &settings, &given[end..]].concat()),
        None => Some(given),
    }
}

/// Moves the settings of the attribute `XMP` to attributes of their own. The rest of the packet remains, if there is
/// any.
pub fn take(attributes: &mut Params) {
    let Some(given) = given(attributes) else { return };
    let Some(start) = given.find(OPEN) else { return };
    let Some(length) = given[start..].find(CLOSE) else { return };
    let mut items = &given[start + OPEN.len()..start + length];
    let mut found = Vec::new();
    while let Some((text, rest)) = items.strip_prefix(ITEM.0).and_then(|rest| rest.split_once(ITEM.1)) {
        let text = unescaped(text);
        if let Some((name, value)) = text.split_once('=') {
            found.push((format!("{PREFIX}{name}"), value.to_owned()));
        }
        items = rest;
    }
    if !items.is_empty() {
        return;
    }
    let rest = [&given[..start], &given[start + length + CLOSE.len()..]].concat();
    let is_own = rest.strip_prefix(PACKET.0) == Some(PACKET.1);
    attributes.0.retain(|param| !is_own || !param.name.eq_ignore_ascii_case("XMP"));
    let mut set = |name: &str, text: &str| {
        attributes.set(Param { name: name.into(), ty: ParamType::of(BaseType::String), data: text.into() });
    };
    if !is_own {
        set("XMP", &rest);
    }
    found.iter().for_each(|(name, value)| set(name, value));
}

/// Returns the attribute `XMP`.
fn given(attributes: &Params) -> Option<String> {
    match super::value(attributes, "XMP")? {
        ParamData::String(texts) => texts.first().map(|text| text.to_string()),
        _ => None,
    }
}

/// Returns a text in XML. Characters that XML cannot hold are left out.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars().filter(|c| !c.is_control()) {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c => out.push(c),
        }
    }
    out
}

/// Does the inverse of [`escaped`].
fn unescaped(text: &str) -> String {
    text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(list: &[(&str, &str)]) -> Params {
        Params(list.iter().map(|(n, v)| Param::declared(&format!("string {n}"), *v).unwrap()).collect())
    }

    #[test]
    fn settings_survive_a_packet_of_their_own() {
        let own = params(&[("granita/camera", "a <b> &amp; c"), ("granita/filter/N=1", "box 1 1")]);
        let text = packet(&own).unwrap();
        assert!(text.contains("<rdf:li>camera=a &lt;b&gt; &amp;amp; c</rdf:li>"), "{text}");
        let mut read = params(&[("XMP", &text)]);
        take(&mut read);
        assert_eq!(read.string("granita/camera").map(|s| s.to_string()).as_deref(), Some("a <b> &amp; c"));
        assert!(read.get("XMP").is_none());
        assert_eq!((packet(&Params::new()), packet(&read)), (None, Some(packet(&read).unwrap())));
    }

    #[test]
    fn other_parts_of_a_packet_stay() {
        let given = "<x><rdf:RDF><a/></rdf:RDF></x>";
        let both = params(&[("XMP", given), ("granita/samples", "4 4")]);
        let text = packet(&both).unwrap();
        let mut read = params(&[("XMP", &text)]);
        take(&mut read);
        assert_eq!(read.string("XMP").map(|s| s.to_string()).as_deref(), Some(given));
        assert_eq!(read.string("granita/samples").map(|s| s.to_string()).as_deref(), Some("4 4"));
        assert_eq!(packet(&params(&[("XMP", "none"), ("granita/samples", "4 4")])).as_deref(), Some("none"));
    }

    #[test]
    fn damaged_settings_stay_in_the_packet() {
        for text in
            [OPEN.to_owned(), format!("{OPEN}<rdf:li>{CLOSE}"), format!("{OPEN}x{CLOSE}"), String::new()]
        {
            let mut read = params(&[("XMP", &text)]);
            take(&mut read);
            assert_eq!(read.string("XMP").map(|s| s.to_string()), Some(text));
        }
    }
}
