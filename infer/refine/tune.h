#pragma once
#include <cstdlib>
inline double Tune(const char* name, double value) {
  const char* text = std::getenv(name);
  return text ? std::atof(text) : value;
}
