#include "infrasim/core/hints.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace infrasim {

namespace {

/// Returns the edit distance of two words: the minimum number of letters to change, insert or
/// remove.
std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0U);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({changed, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

bool is_digits(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
}

}  // namespace

std::string suggestion(std::string_view word, const std::vector<std::string>& known) {
  const auto nearest = std::ranges::min_element(
      known, {}, [&](const std::string& name) { return edits(name, word); });
  if (nearest == known.end() || edits(*nearest, word) > word.size() / 3) return "";
  return "; did you mean '" + *nearest + "'?";
}

std::string comma_hint(std::string_view word) {
  if (word.starts_with('-') || word.starts_with('+')) word.remove_prefix(1);
  const std::size_t comma = std::min(word.find(','), word.size());
  if (comma == word.size() || !is_digits(word.substr(0, comma)) ||
      !is_digits(word.substr(comma + 1)))
    return "";
  return "; numbers have a decimal point, not a comma";
}

}  // namespace infrasim
