// Makes a `Component` of a model class: its first member is `Ports ports`, its member functions are
// `initialise(start_time)`, `step(time, dt)` and `parameter_error()`.
#pragma once

#include <cstddef>
#include <cstring>
#include <new>
#include <type_traits>

#include "fmus/shell/component.hpp"

namespace rotordx {

/// The functions of a component, for untyped memory that holds a `Model`.
template <class Model>
struct ModelAdapter {
  static_assert(std::is_trivially_copyable_v<Model> && std::is_trivially_destructible_v<Model>,
                "the FMU state is copied as plain memory");
  static_assert(std::is_standard_layout_v<Model> && offsetof(Model, ports) == 0, "the values come first");
  static_assert(alignof(Model) <= 16, "calloc aligns to 16 bytes");

  /// A new model with these values; padding is cleared too, so that equal states are equal bytes.
  static void construct(void* memory, const double* values) {
    std::memset(memory, 0, sizeof(Model));
    Model* model = new (memory) Model{};
    std::memcpy(model->ports.value, values, sizeof model->ports.value);
  }

  /// Initialisation may be repeated while inputs and parameters still change: it always begins with a new model.
  static void initialise(void* memory, double start_time) {
    const Ports ports = static_cast<Model*>(memory)->ports;
    construct(memory, ports.value);
    static_cast<Model*>(memory)->initialise(start_time);
  }

  static const char* parameter_error(const void* memory) {
    return static_cast<const Model*>(memory)->parameter_error();
  }

  /// Time is a product, never a sum: it does not drift.
  static void advance(void* memory, double start_time, std::int64_t step, std::int64_t count, double step_size) {
    Model* model = static_cast<Model*>(memory);
    for (std::int64_t k = step; k < step + count; ++k) {
      model->step(start_time + static_cast<double>(k) * step_size, step_size);
    }
  }
};

/// The component that `Model` is, with the tables generated from its port declarations.
template <class Model>
constexpr Component describe(const char* name, const char* token, const Variable* variables,
                             const std::uint16_t* variable_of, const double* start, bool tunable_parameters) {
  using Adapter = ModelAdapter<Model>;
  return {name,
          token,
          variables,
          variable_of,
          start,
          Ports::kCount,
          Ports::kStepSize,
          Ports::kOutputs,
          tunable_parameters,
          sizeof(Model),
          Adapter::construct,
          Adapter::initialise,
          Adapter::parameter_error,
          Adapter::advance};
}

}  // namespace rotordx
