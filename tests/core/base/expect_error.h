#pragma once

#include <gtest/gtest.h>

#include <exception>
#include <initializer_list>
#include <string>
#include <typeinfo>

#include "core/base/error.h"

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

/// Expects `call` to throw exactly an `E` whose message is one line that holds every one of
/// `parts`. Returns the message.
template <class E, class Call>
std::string ExpectError(Call&& call, std::initializer_list<std::string> parts = {}) {
  try {
    call();
  } catch (const std::exception& e) {
    const std::string text = e.what();
    EXPECT_TRUE(typeid(e) == typeid(E)) << "thrown: " << typeid(e).name() << ": " << text;
    EXPECT_FALSE(text.empty());
    EXPECT_FALSE(Has(text, "\n"));
    for (const std::string& part : parts) EXPECT_TRUE(Has(text, part));
    return text;
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

}  // namespace volalign
