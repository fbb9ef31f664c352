#pragma once

#include <stdexcept>
#include <string>

namespace volalign {

/// Base of everything that volalign's libraries throw. The message is one line that says what is
/// wrong, its value, where it stands and what to do; only `main` catches it.
class Error : public std::runtime_error {
 public:
  /// Keeps the MessageLine of it (core/base/text.h): nothing that a message quotes can forge or
  /// flood what a terminal, a log or Python shows.
  explicit Error(const std::string& message);
};

/// A configuration key is unknown, duplicated, of the wrong type or out of its range.
class ConfigError : public Error {
 public:
  using Error::Error;
};

/// A file's content is not what its format promises (truncated image, NaN, wrong version, ...).
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
