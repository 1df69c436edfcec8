//! Finds the nearest valid choice for a misspelt word, for messages.

/// Returns the candidate that a misspelt `word` most likely means, if one is near enough.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Longer words are not spelling mistakes, and the memory for a distance grows with the square
    // of the length.
    let short = |w: &&str| w.len() <= 100;
    let lower = Some(word).filter(short)?.to_lowercase();
    let near = lower.chars().count().div_ceil(3).max(1);
    candidates
        .into_iter()
        .filter(short)
        .filter_map(|candidate| {
            let other = candidate.to_lowercase();
            let distance = strsim::damerau_levenshtein(&lower, &other);
            // A part of a word matches: "lights" means `lightsources`, "color" means
            // `diffusecolor`.
            let part = lower.chars().count() >= 4 && other.contains(&lower);
            let score = if part { distance.min(near) } else { distance };
            (score <= near).then_some((score, candidate))
        })
        .min_by_key(|(score, _)| *score)
        .map(|(_, candidate)| candidate)
}

/// Returns a help text with the result of [`nearest`].
pub fn did_you_mean<'a>(
    word: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<String> {
    nearest(word, candidates).map(|near| format!("did you mean `{}`?", near.escape_debug()))
}

/// Formats a list of choices: `` `a`, `b` or `c` ``.
pub fn list<'a>(words: impl IntoIterator<Item = &'a str>) -> String {
    let quoted: Vec<String> = words.into_iter().map(|w| format!("`{w}`")).collect();
    match quoted.split_last() {
        None => String::new(),
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
    }
}
