#pragma once

#include <string>
#include <vector>

namespace volalign {

/// A reader of what comes from anywhere, fed with the bytes of a file of its kind.
struct FuzzTarget {
  const char* name;  ///< of its archive in tests/fuzz/corpus, without .tar
  void (*read)(const std::string& bytes);
};

/// Every entry point of files that volalign did not write itself.
const std::vector<FuzzTarget>& FuzzTargets();

/// Has `target` read the bytes, twice. Returns the message where it refused them: an Error of one
/// line. Anything else that is thrown comes through; throws std::logic_error for a message that is
/// long, not UTF-8, or another one in the second reading, as of memory that was never written.
std::string ReadFuzzInput(const FuzzTarget& target, const std::string& bytes);

}  // namespace volalign
