//! Checks that the documentation of public functions that return a `Result` has a section "# Errors".

use crate::source::Source;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

/// Returns all breaches, one line each.
pub(crate) fn check(sources: &[Source]) -> Result<Vec<String>, String> {
    let mut faults = Vec::new();
    for source in sources.iter().filter(|source| !source.is_test) {
        let file = syn::parse_file(&source.text).map_err(|e| format!("{}: {e}", source.file.display()))?;
        for (line, name) in lacking(&file) {
            faults.push(format!(
                "{}:{line}: {name} returns a Result and has no section # Errors",
                source.file.display()
            ));
        }
        for (line, text) in (1..).zip(source.text.lines()) {
            let comment = text.trim_start().trim_start_matches("///").trim_start_matches("//!").trim_start();
            if comment.len() < text.trim_start().len() && comment.starts_with("Errors:") {
                faults.push(format!(
                    "{}:{line}: `Errors:` instead of a section # Errors",
                    source.file.display()
                ));
            }
        }
    }
    Ok(faults)
}

/// Returns the lines and names of the public functions of a file without the section.
fn lacking(file: &syn::File) -> Vec<(usize, String)> {
    let mut finder = Finder { found: Vec::new(), in_public_trait: false };
    finder.visit_file(file);
    finder.found
}

struct Finder {
    found: Vec<(usize, String)>,
    in_public_trait: bool,
}

impl Finder {
    fn check(&mut self, attributes: &[syn::Attribute], signature: &syn::Signature) {
        if returns_result(signature) && !has_section(attributes) {
            self.found.push((signature.ident.span().start().line, signature.ident.to_string()));
        }
    }
}

impl<'ast> Visit<'ast> for Finder {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_test(&module.attrs) {
            visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_fn(&mut self, function: &'ast syn::ItemFn) {
        if is_public(&function.vis) && !is_test(&function.attrs) {
            self.check(&function.attrs, &function.sig);
        }
        visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        if is_public(&function.vis) && !is_test(&function.attrs) {
            self.check(&function.attrs, &function.sig);
        }
        visit::visit_impl_item_fn(self, function);
    }

    fn visit_item_trait(&mut self, item: &'ast syn::ItemTrait) {
        let outer = std::mem::replace(&mut self.in_public_trait, is_public(&item.vis));
        visit::visit_item_trait(self, item);
        self.in_public_trait = outer;
    }

    fn visit_trait_item_fn(&mut self, function: &'ast syn::TraitItemFn) {
        if self.in_public_trait {
            self.check(&function.attrs, &function.sig);
        }
        visit::visit_trait_item_fn(self, function);
    }
}

fn is_public(visibility: &syn::Visibility) -> bool {
    matches!(visibility, syn::Visibility::Public(_))
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute.parse_args::<syn::Ident>().is_ok_and(|word| word == "test")
            && attribute.span().start().line > 0
    })
}

fn returns_result(signature: &syn::Signature) -> bool {
    let syn::ReturnType::Type(_, ty) = &signature.output else { return false };
    matches!(&**ty, syn::Type::Path(path) if path.path.segments.last().is_some_and(|last| last.ident == "Result"))
}

fn has_section(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().filter(|attribute| attribute.path().is_ident("doc")).any(|attribute| {
        let syn::Meta::NameValue(value) = &attribute.meta else { return false };
        let syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) = &value.value else {
            return false;
        };
        text.value().trim() == "# Errors"
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn public_functions_without_an_errors_section_are_found() {
        let code = "/// A.\npub fn a() -> Result<()> {}\n/// B.\n///\n/// # Errors\n/// Never.\npub fn b() -> io::Result<()> {}\n\
                    pub(crate) fn c() -> Result<()> {}\npub fn d() -> Option<Result<()>> {}\n\
                    impl S {\n    pub fn e() -> fmt::Result {}\n}\npub trait T {\n    fn f() -> Result<()>;\n}\n\
                    trait U {\n    fn g() -> Result<()>;\n}\nimpl T for S {\n    fn f() -> Result<()> {}\n}\n\
                    #[cfg(test)]\nmod tests { pub fn h() -> Result<()> {} }";
        let found = lacking(&syn::parse_file(code).unwrap());
        let names: Vec<(usize, &str)> = found.iter().map(|(line, name)| (*line, name.as_str())).collect();
        assert_eq!(names, [(2, "a"), (11, "e"), (14, "f")]);
        let source = Source::new("src/a.rs".into(), "/// Errors: never.\nfn a() {}".to_owned()).unwrap();
        assert_eq!(check(&[source]).unwrap().len(), 1);
    }
}
