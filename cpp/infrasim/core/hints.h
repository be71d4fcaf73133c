#pragma once

#include <string>
#include <string_view>
#include <vector>

// Functions that make the end of an error message: a hint at what the user probably meant.

namespace infrasim {

/// Returns a text such as `; did you mean 'highway'?`, or an empty text if no name is similar.
std::string suggestion(std::string_view word, const std::vector<std::string>& known);

/// Returns a remark about decimal points if the word is a number with a decimal comma, such as 3,5.
/// Returns an empty text for any other word.
std::string comma_hint(std::string_view word);

}  // namespace infrasim
