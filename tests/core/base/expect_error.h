#pragma once

#include <gtest/gtest.h>

#include <exception>
#include <initializer_list>
#include <string>
#include <typeinfo>

namespace volalign {

/// Expects `call` to throw exactly an `E` whose message is one line that holds every one of
/// `parts`.
template <class E, class Call>
void ExpectError(Call&& call, std::initializer_list<std::string> parts = {}) {
  try {
    call();
  } catch (const std::exception& e) {
    const std::string text = e.what();
    EXPECT_TRUE(typeid(e) == typeid(E)) << "thrown: " << typeid(e).name() << ": " << text;
    EXPECT_FALSE(text.empty());
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    for (const std::string& part : parts) {
      EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is not in: " << text;
    }
    return;
  }
  ADD_FAILURE() << "nothing was thrown";
}

}  // namespace volalign
