#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <string>

namespace volalign {

/// Whether the text has every one of the parts; says which one it has not, or has.
template <class... Parts>
testing::AssertionResult Has(const std::string& text, const Parts&... parts) {
  for (const std::string& part : std::initializer_list<std::string>{parts...}) {
    if (text.find(part) == std::string::npos)
      return testing::AssertionFailure() << "'" << part << "' is not in: " << text;
  }
  return testing::AssertionSuccess() << text;
}

}  // namespace volalign
