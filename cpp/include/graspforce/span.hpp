// Views of numbers that stand elsewhere: a piece of a list, a row-major matrix, a single one.
#pragma once

#include <algorithm>
#include <cstddef>

namespace graspforce {

template <class T>
class Span {
 public:
  Span() = default;
  Span(T* first, int size) : first_(first), size_(size) {}
  T* begin() const { return first_; }
  T* end() const { return first_ + size_; }
  T* data() const { return first_; }
  int size() const { return size_; }
  T& operator[](int i) const { return first_[i]; }

 private:
  T* first_ = nullptr;
  int size_ = 0;
};

// Row-major, without gaps: Eigen::Map<Matrix<double, Dynamic, Dynamic, RowMajor>> takes it as it
// is.
class Matrix {
 public:
  Matrix() = default;
  Matrix(double* first, int rows, int columns) : first_(first), rows_(rows), columns_(columns) {}
  int rows() const { return rows_; }
  int columns() const { return columns_; }
  double* data() const { return first_; }
  double& operator()(int row, int column) const {
    return first_[static_cast<std::ptrdiff_t>(row) * columns_ + column];
  }
  Span<double> entries() const { return {first_, rows_ * columns_}; }

 private:
  double* first_ = nullptr;
  int rows_ = 0, columns_ = 0;
};

// Written and read like a double.
class Scalar {
 public:
  explicit Scalar(double* at) : at_(at) {}
  operator double&() const { return *at_; }
  const Scalar& operator=(double value) const {
    *at_ = value;
    return *this;
  }

 private:
  double* at_;
};

}  // namespace graspforce
