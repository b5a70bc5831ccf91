use std::fmt::Write;

use nalgebra::Vector2;

/// `text` as the content or an attribute of an element.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            control if control.is_control() => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}

/// A coordinate with two decimals and no superfluous zeros; anything not finite counts as 0, as SVG knows no other.
pub(crate) fn number(value: f64) -> String {
    let value = if value.is_finite() { value } else { 0.0 };
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Path data through `points`, already in drawing coordinates.
pub(crate) fn polyline(points: impl IntoIterator<Item = Vector2<f64>>) -> String {
    let mut data = String::new();
    for (index, point) in points.into_iter().enumerate() {
        let command = if index == 0 { 'M' } else { 'L' };
        let _ = write!(data, "{command}{} {}", number(point.x), number(point.y));
    }
    data
}

/// Path data that puts a round dot at each of `points` when stroked with round caps.
pub(crate) fn dots(points: impl IntoIterator<Item = Vector2<f64>>) -> String {
    let mut data = String::new();
    for point in points {
        let _ = write!(data, "M{} {}h0", number(point.x), number(point.y));
    }
    data
}

/// The round number (1, 2 or 5 times a power of ten) nearest below `value`.
pub(crate) fn round_below(value: f64) -> f64 {
    let power = 10.0_f64.powf(value.max(1e-9).log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|digit| digit * power).find(|round| *round <= value).unwrap_or(power)
}

/// Round ticks from 0 up to at least `top`, about `count` of them.
pub(crate) fn ticks(top: f64, count: f64) -> Vec<f64> {
    let top = if top.is_finite() && top > 0.0 { top } else { 1.0 };
    let step = round_below(2.0 * top / count);
    let last = (top / step).ceil() as usize;
    (0..=last).map(|index| index as f64 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_data_cannot_leave_its_element() {
        assert_eq!(escape("<b a='1'>&\"\u{7}"), "&lt;b a=&#39;1&#39;&gt;&amp;&quot; ");
    }

    #[test]
    fn ticks_are_round_and_cover_the_range() {
        assert_eq!(ticks(7.3, 4.0), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(ticks(0.0, 4.0).last(), Some(&1.0));
        assert_eq!((number(-0.001), number(f64::NAN), number(1.50)), ("0".into(), "0".into(), "1.5".into()));
    }
}
