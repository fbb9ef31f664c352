#pragma once

#include <stdexcept>
#include <string>

namespace volalign {

/// Base of all errors that volalign's libraries throw. The message is one line: what is wrong, its
/// value, its place and what to do. Only `main` catches it.
class Error : public std::runtime_error {
 public:
  /// Keeps the MessageLine of it (core/base/text.h). So no quoted text can forge or flood the
  /// output of a terminal, a log or Python.
  explicit Error(const std::string& message);
};

/// A configuration key is unknown, duplicated, of the wrong type or out of its range.
class ConfigError : public Error {
 public:
  using Error::Error;
};

/// A file's content violates its format (truncated image, NaN, wrong version, ...).
class DataError : public Error {
 public:
  using Error::Error;
};

/// A file or device could not be opened, read or written.
class IoError : public Error {
 public:
  using Error::Error;
};

}  // namespace volalign
