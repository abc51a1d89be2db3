// What the shell knows about the component it is linked with: variables, start values, size and four functions.
#pragma once

#include <cstddef>
#include <cstdint>

namespace rotordx {

/// A port: `size` float64 values from `first` on in the model's value array.
struct Variable {
  const char* name;
  std::uint32_t first;
  std::uint32_t size;
  bool array;        ///< its elements are called name[1], name[2], ...
  bool enumeration;  ///< FMI's Integer or Int64 interface, values are whole numbers
  double minimum;
  double maximum;
};

/// Values lie in the order inputs, step_size, other parameters, outputs; a value reference is an offset.
struct Component {
  const char* name;
  const char* token;  ///< GUID or instantiation token
  const Variable* variables;
  const std::uint16_t* variable_of;  ///< index of the variable that each value belongs to
  const double* start;
  std::uint32_t value_count;
  std::uint32_t step_size;  ///< offset, also the number of input values
  std::uint32_t outputs;    ///< offset
  bool tunable_parameters;

  std::size_t model_size;  ///< of a trivially copyable block that begins with the values
  void (*construct)(void* model, const double* values);
  void (*initialise)(void* model, double start_time);
  const char* (*parameter_error)(const void* model);  ///< nullptr or a sentence
  void (*advance)(void* model, double start_time, std::int64_t step, std::int64_t count, double step_size);
};

/// Defined by the generated source of each component.
extern const Component component __attribute__((visibility("hidden")));

}  // namespace rotordx
