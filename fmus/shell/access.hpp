// Reading and writing variables by value reference, for element-wise (FMI 2) and array-wise (FMI 3) references alike.
#pragma once

#include <cmath>
#include <type_traits>

#include "fmus/shell/instance.hpp"

namespace rotordx {

/// Whether a value reference names one element or a whole port.
enum class Addressing { kElements, kArrays };

/// The values behind a value reference; none if it is unknown.
struct Span {
  std::uint32_t first;
  std::uint32_t size;
};

inline const Variable& variable_at(std::uint32_t offset) { return component.variables[component.variable_of[offset]]; }

inline bool is_parameter(std::uint32_t offset) { return offset >= component.step_size && offset < component.outputs; }

/// Resolves a reference for values of type T: doubles are floating-point ports, integers enumerations.
template <Addressing addressing, class T>
Span resolve(std::uint32_t reference) {
  if (reference >= component.value_count) return {reference, 0};
  const Variable& variable = variable_at(reference);
  if (variable.enumeration != std::is_integral_v<T>) return {reference, 0};
  if constexpr (addressing == Addressing::kElements) return {reference, 1};
  return {reference, variable.first == reference ? variable.size : 0};
}

/// Each sends a message and returns false.
bool refuse_reference(const Instance& instance, std::uint32_t reference);
bool refuse_count(const Instance& instance, std::size_t value_count);

/// Checks a value against the declaration of its parameter; sends a message unless it may be stored.
bool parameter_accepts(const Instance& instance, std::uint32_t offset, double value);

/// An input takes every finite value.
inline bool accepts(const Instance& instance, std::uint32_t offset, double value) {
  return (offset < component.step_size && std::isfinite(value)) || parameter_accepts(instance, offset, value);
}

/// What happens in every step, without a look at the variables: finite values for single inputs. False if it is not.
inline bool set_inputs(Instance& instance, const std::uint32_t* references, std::size_t count, const double* values) {
  bool plain = instance.clock.phase == Phase::kStep;
  for (std::size_t i = 0; i < count; ++i) plain &= (references[i] < component.step_size) & std::isfinite(values[i]);
  if (!plain) return false;
  double* to = instance.values();
  for (std::size_t i = 0; i < count; ++i) to[references[i]] = values[i];
  return true;
}

/// Likewise for single inputs and outputs; only parameters may be enumerations.
inline bool get_plain(const Instance& instance, const std::uint32_t* references, std::size_t count, double* values) {
  if (!instance.clock.initialised) return false;
  const double* from = instance.values();
  for (std::size_t i = 0; i < count; ++i) {
    if (references[i] >= component.value_count || is_parameter(references[i])) return false;
    values[i] = from[references[i]];
  }
  return true;
}

/// Stores all values or, if one of them is refused, none.
template <Addressing addressing, class T>
bool set(Instance& instance, const std::uint32_t* references, std::size_t count, const T* values,
         std::size_t value_count) {
  if constexpr (addressing == Addressing::kElements && !std::is_integral_v<T>) {
    if (set_inputs(instance, references, count, values)) return true;
  }
  if (!require(instance, in(Phase::kInstantiated) | in(Phase::kInitialisation) | in(Phase::kStep), "setting")) {
    return false;
  }
  std::size_t next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Span span = resolve<addressing, T>(references[i]);
    if (span.size == 0) return refuse_reference(instance, references[i]);
    if (next + span.size > value_count) return refuse_count(instance, value_count);
    for (std::uint32_t k = 0; k < span.size; ++k, ++next) {
      if (!accepts(instance, span.first + k, static_cast<double>(values[next]))) return false;
    }
  }
  if (next != value_count) return refuse_count(instance, value_count);
  next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Span span = resolve<addressing, T>(references[i]);
    for (std::uint32_t k = 0; k < span.size; ++k, ++next) {
      instance.values()[span.first + k] = static_cast<double>(values[next]);
    }
  }
  if (instance.clock.phase == Phase::kInitialisation) instance.clock.initialised = 0;
  return true;
}

/// Reads values; outputs are initialised first if they are asked for in initialisation mode.
template <Addressing addressing, class T>
bool get(Instance& instance, const std::uint32_t* references, std::size_t count, T* values, std::size_t value_count) {
  if constexpr (addressing == Addressing::kElements && !std::is_integral_v<T>) {
    if (get_plain(instance, references, count, values)) return true;
  }
  std::size_t next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if constexpr (addressing == Addressing::kArrays && !std::is_integral_v<T>) {
      if (references[i] == component.value_count && next < value_count) {  // the independent variable
        values[next++] = instance.time();
        continue;
      }
    }
    const Span span = resolve<addressing, T>(references[i]);
    if (span.size == 0) return refuse_reference(instance, references[i]);
    if (next + span.size > value_count) return refuse_count(instance, value_count);
    if (span.first >= component.outputs && !instance.clock.initialised) {
      if (!require(instance, in(Phase::kInitialisation), "reading outputs") || !settle(instance)) return false;
    }
    const double* from = instance.values() + span.first;
    for (std::uint32_t k = 0; k < span.size; ++k) values[next++] = static_cast<T>(from[k]);
  }
  return next == value_count || refuse_count(instance, value_count);
}

}  // namespace rotordx
