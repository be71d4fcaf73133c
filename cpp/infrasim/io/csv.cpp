#include "infrasim/io/csv.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"

namespace infrasim {

CsvReader::CsvReader(const std::filesystem::path& file, std::string_view header,
                     std::string_view optional)
    : name_(file.string()),
      stream_(open_file(file)),
      columns_(std::ranges::count(header, ',') + 1) {
  next_line();
  std::string found(header);
  for (std::string_view rest = optional; !rest.empty();) {
    const auto end = std::min(rest.find(','), rest.size());
    const std::string column(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    std::string longer = found;
    longer += ',';
    longer += column;
    if (row_ != longer && !row_.starts_with(longer + ",")) continue;
    found = std::move(longer);
    extra_.push_back(column);
  }
  columns_ += std::ssize(extra_);
  if (row_ == found) return;
  const bool several = optional.find(',') != std::string_view::npos;
  fail_row("(header)",
           "expected '" + std::string(header) + "'" +
               (several ? ", then any of '" + std::string(optional) + "' in this order" : "") +
               ", got '" + std::string(row_.substr(0, 80)) + "'");
}

bool CsvReader::has(std::string_view column) const {
  return std::ranges::find(extra_, column) != extra_.end();
}

void CsvReader::next_line() {
  ++line_;
  cell_ = next_cell_ = 0;
  stream_.getline(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
  if (stream_.bad()) throw IoError(name_ + ": can't be read");
  // gcount() includes the line break, which only the last line of the file may lack.
  const bool is_last = stream_.eof(), is_cut = stream_.fail() && !is_last;
  const auto count = static_cast<std::size_t>(stream_.gcount());
  row_.assign(buffer_.data(), is_last || is_cut ? count : count - 1);
  if (is_cut)
    fail_row("(row)", "expected a row of less than " + std::to_string(buffer_.size()) +
                          " bytes, got a longer one");
  if (row_.ends_with('\r')) row_.pop_back();
  if (line_ == 1 && row_.starts_with(kByteOrderMark)) row_.erase(0, kByteOrderMark.size());
}

bool CsvReader::next_row() {
  if (!stream_ || stream_.peek() == std::ifstream::traits_type::eof()) return false;
  next_line();
  if (const auto columns = std::ranges::count(row_, ',') + 1; columns != columns_)
    fail_row("(row)", "expected " + std::to_string(columns_) + " columns, got '" +
                          std::string(std::string_view(row_).substr(0, 80)) + "'");
  return true;
}

std::string_view CsvReader::cell() {
  assert(next_cell_ <= row_.size());
  const auto end = std::min(row_.find(',', next_cell_), row_.size());
  cell_ = next_cell_;
  next_cell_ = end + 1;
  return std::string_view(row_).substr(cell_, end - cell_);
}

double CsvReader::number(std::string_view key, double low, double high) {
  const std::string_view text = cell();
  const auto value = parse_number<double>(text);
  if (!value || !(*value >= low && *value <= high))
    fail(key, "expected a number from " + fixed_text(low, 6) + " to " + fixed_text(high, 6) +
                  ", got '" + std::string(text.substr(0, 40)) + "'");
  return *value;
}

double CsvReader::number_or(double blank, std::string_view key, double low, double high) {
  const std::size_t before = next_cell_;
  if (cell().empty()) return blank;
  next_cell_ = before;
  return number(key, low, high);
}

void CsvReader::fail(std::string_view key, const std::string& what) const {
  fail_at(cell_, key, what);
}

void CsvReader::fail_row(std::string_view key, const std::string& what) const {
  fail_at(0, key, what);
}

void CsvReader::fail_at(std::size_t place, std::string_view key, const std::string& what) const {
  throw ConfigError(name_ + ":" + std::to_string(line_) + ":" + std::to_string(place + 1) + ": " +
                    std::string(key) + ": " + what);
}

}  // namespace infrasim
