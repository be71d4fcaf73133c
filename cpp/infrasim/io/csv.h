#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace infrasim {

/// Reads rows of comma-separated cells under a given header, one after the other. Cells must not be
/// quoted. A line ends in \n or \r\n. A byte-order mark at the beginning is ignored. All parsing
/// errors are ConfigErrors with file, line and column.
class CsvReader {
 public:
  /// @param optional names of columns that may follow those of the header, in this order; any of
  /// them may be missing
  /// @throws ConfigError if the first line is not the header, IoError if the file can't be read
  CsvReader(const std::filesystem::path& file, std::string_view header,
            std::string_view optional = "");
  CsvReader(const CsvReader&) = delete;
  CsvReader& operator=(const CsvReader&) = delete;

  /// Returns whether the file has any optional column.
  bool has_last() const { return !extra_.empty(); }
  /// Returns whether the file has the optional column `column`.
  bool has(std::string_view column) const;
  /// Goes to the first or next row; returns false if there is none.
  /// @throws ConfigError if the row has fewer or more cells than the header
  bool next_row();
  /// Returns the next cell of the row.
  std::string_view cell();
  /// Returns the row's next cell as a number; messages use `key` as its name.
  /// @throws ConfigError if the cell is not a number in [low, high]
  double number(std::string_view key, double low, double high);
  /// Like number(), but returns `blank` for a blank cell.
  double number_or(double blank, std::string_view key, double low, double high);

  /// Throws an error about the cell that was read last.
  [[noreturn]] void fail(std::string_view key, const std::string& what) const;
  /// Throws an error about the whole row.
  [[noreturn]] void fail_row(std::string_view key, const std::string& what) const;

 private:
  void next_line();
  [[noreturn]] void fail_at(std::size_t place, std::string_view key, const std::string& what) const;

  std::string name_;
  std::ifstream stream_;
  /// memory for the next line
  std::vector<char> buffer_ = std::vector<char>(std::size_t{1} << 16);
  std::string row_;            ///< the current line
  std::size_t cell_ = 0;       ///< start of the current cell in row_
  std::size_t next_cell_ = 0;  ///< start of the next cell in row_
  std::ptrdiff_t columns_;
  int line_ = 0;
  std::vector<std::string> extra_;  ///< the optional columns of the file
};

}  // namespace infrasim
