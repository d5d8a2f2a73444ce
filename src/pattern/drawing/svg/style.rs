//! How elements of SVG are filled: by attributes, styles and style sheets.

use roxmltree::{Document, Node};
use simplecss::{AttributeOperator, Declaration, DeclarationTokenizer, PseudoClass};

use crate::contour::FillRule;

/// How an element is filled.
#[derive(Clone)]
pub struct Style {
    pub is_filled: bool,
    pub is_white: bool,
    pub rule: FillRule,
    /// Whether neither it nor what it contains is shown.
    pub is_hidden: bool,
}

impl Default for Style {
    fn default() -> Self {
        Self {
            is_filled: true,
            is_white: false,
            rule: FillRule::NonZero,
            is_hidden: false,
        }
    }
}

/// The style sheets of a document.
pub struct StyleSheet<'a>(simplecss::StyleSheet<'a>);

impl<'a> StyleSheet<'a> {
    pub fn of(document: &'a Document<'_>) -> Self {
        let mut sheet = simplecss::StyleSheet::new();
        let styles = document.descendants().filter(|node| node.tag_name().name() == "style");
        styles
            .filter_map(|node| node.text())
            .for_each(|text| sheet.parse_more(text));
        Self(sheet)
    }

    /// Returns the style of an element with what it inherits.
    pub fn style(&self, node: Node<'_, '_>, inherited: &Style) -> Style {
        let mut style = inherited.clone();
        for attribute in node.attributes().filter(|attribute| attribute.namespace().is_none()) {
            style.set(attribute.name(), attribute.value());
        }
        let rules = self.0.rules.iter().filter(|rule| rule.selector.matches(&Element(node)));
        let declared: Vec<&Declaration<'_>> = rules.flat_map(|rule| &rule.declarations).collect();
        let own = node.attribute("style").into_iter().flat_map(DeclarationTokenizer::from);
        let own: Vec<Declaration<'_>> = own.collect();
        let usual = declared
            .iter()
            .copied()
            .filter(|declared| !declared.important)
            .chain(&own);
        let important = declared.iter().copied().filter(|declared| declared.important);
        usual
            .chain(important)
            .for_each(|declared| style.set(declared.name, declared.value));
        style
    }
}

impl Style {
    fn set(&mut self, name: &str, value: &str) {
        let value = value.trim();
        let is_zero = || value.trim_end_matches('%').parse::<f64>() == Ok(0.0);
        match (name, value) {
            (_, "inherit") => {}
            ("fill", "none" | "transparent") => self.is_filled = false,
            ("fill", colour) => {
                self.is_filled = true;
                let colour = colour.replace(' ', "").to_ascii_lowercase();
                self.is_white =
                    ["white", "#fff", "#ffffff", "rgb(255,255,255)", "rgb(100%,100%,100%)"].contains(&colour.as_str());
            }
            ("fill-opacity", _) if is_zero() => self.is_filled = false,
            ("opacity", _) if is_zero() => self.is_hidden = true,
            ("fill-rule", "evenodd") => self.rule = FillRule::EvenOdd,
            ("fill-rule", _) => self.rule = FillRule::NonZero,
            ("display", "none") | ("visibility", "hidden" | "collapse") => self.is_hidden = true,
            _ => {}
        }
    }
}

/// An element, for selectors.
struct Element<'a, 'input>(Node<'a, 'input>);

impl simplecss::Element for Element<'_, '_> {
    fn parent_element(&self) -> Option<Self> {
        self.0.parent_element().map(Element)
    }

    fn prev_sibling_element(&self) -> Option<Self> {
        self.0.prev_sibling_element().map(Element)
    }

    fn has_local_name(&self, name: &str) -> bool {
        self.0.tag_name().name() == name
    }

    fn attribute_matches(&self, name: &str, operator: AttributeOperator<'_>) -> bool {
        self.0.attribute(name).is_some_and(|value| operator.matches(value))
    }

    fn pseudo_class_matches(&self, class: PseudoClass<'_>) -> bool {
        class == PseudoClass::FirstChild && self.0.prev_sibling_element().is_none()
    }
}
