#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace infrasim {

/// Reads rows of comma-separated cells under a header that is given, one after the other. A cell
/// has no quotes; a line ends in \n or \r\n.
/// Each of its errors is a ConfigError that names file, line and column.
class CsvReader {
 public:
  /// @param last column that a file may have after those of the header; empty: none
  /// @throws ConfigError if the first line is not the header, IoError if the file can't be read
  CsvReader(const std::filesystem::path& file, std::string_view header, std::string_view last = "");
  CsvReader(const CsvReader&) = delete;  // it views its own text
  CsvReader& operator=(const CsvReader&) = delete;

  /// Whether the file has the last column.
  bool has_last() const { return has_last_; }
  /// Goes to the first or next row; false if there is none.
  /// @throws ConfigError if its cells are not as many as the header's
  bool next_row();
  /// The row's next cell, from its first to its last.
  std::string_view cell();
  /// The row's next cell as a number; `key` names it in messages.
  /// @throws ConfigError if it is none or out of [low, high]
  double number(std::string_view key, double low, double high);
  /// The same where a blank cell stands for `blank`.
  double number_or(double blank, std::string_view key, double low, double high);

  /// Throws about the cell that was read last.
  [[noreturn]] void fail(std::string_view key, const std::string& what) const;
  /// Throws about the row as a whole.
  [[noreturn]] void fail_row(std::string_view key, const std::string& what) const;

 private:
  void next_line();
  [[noreturn]] void fail_at(std::size_t place, std::string_view key, const std::string& what) const;

  std::string name_;
  std::string text_;
  std::string_view rest_;      ///< after the current line
  std::string_view row_;       ///< the current line
  std::size_t cell_ = 0;       ///< where the current cell starts in it
  std::size_t next_cell_ = 0;  ///< and the next one
  std::ptrdiff_t columns_;
  int line_ = 0;
  bool has_last_ = false;
};

}  // namespace infrasim
