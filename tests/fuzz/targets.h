#pragma once

#include <string>
#include <vector>

namespace volalign {

/// A reader of what comes from anywhere, fed with the bytes of a file of its kind.
struct FuzzTarget {
  const char* name;  ///< its folder in tests/fuzz/corpus
  void (*read)(const std::string& bytes);
};

/// Every entry point of files that volalign did not write itself.
const std::vector<FuzzTarget>& FuzzTargets();

/// Has `target` read the bytes. Returns the message where it refused them: an Error of one line.
/// Anything else that is thrown comes through.
std::string ReadFuzzInput(const FuzzTarget& target, const std::string& bytes);

}  // namespace volalign
