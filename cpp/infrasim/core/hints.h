#pragma once

#include <string>
#include <string_view>
#include <vector>

// Ends of messages that name what was probably meant.

namespace infrasim {

/// Returns a text such as `; did you mean 'highway'?`, or an empty text if no name is similar.
std::string suggestion(std::string_view word, const std::vector<std::string>& known);

/// Returns a remark about decimal points if the word is a number with a decimal comma, such as 3,5.
/// Returns an empty text for any other word.
std::string comma_hint(std::string_view word);

}  // namespace infrasim
