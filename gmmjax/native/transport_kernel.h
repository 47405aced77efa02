// Successive shortest paths for one instruction set: included by a translation unit for each.
//
// Prices are kept feasible, row_price + price <= cost, and flow runs on tight arcs alone. A row with supply left is the
// root of a search by reduced costs (Dijkstra's) to the nearest column with demand left; the prices move by the distances,
// and flow is pushed along the path. When no supply is left, the flow is optimal (Ahuja, Magnanti and Orlin 1993, 9.7).

#include <cstdint>
#include <cstring>
#include <limits>

#include "transport.h"

namespace gmmjax::GMMJAX_INSTRUCTION_SET {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Added where something may be 0 that divides, or whose logarithm is taken.
constexpr double kSmallest = 1e-300;
// Of the total mass; what rounding leaves is no supply.
constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();

// Of the range of the costs; an arc that is dearer by less is tight.
constexpr double kTight = 64 * std::numeric_limits<double>::epsilon();

// The entropy of the starting prices, in units of the range of the costs, and their Sinkhorn sweeps.
struct Smoothing {
  double entropy;
  int sweeps;
};
// Of fewer arcs the cheapest are found sooner than good prices; of many, better prices save more than they take.
constexpr int kFewArcs = 100, kManyArcs = 2000;
constexpr Smoothing kSmoothing{0.05, 5}, kSmoothingOfMany{0.03, 10};

using Doubles = Vector<double>;
using Integers = Bits<double>;
constexpr int kLanes = kTransportLanes;

inline double least(double a, double b) { return a < b ? a : b; }

template <typename T>
class Transport {
 public:
  explicit Transport(const TransportProblem<T>& problem) : p_(problem), w_(problem.workspace) {}

  void run() {
    gather();
    if (rows_ > 0 && columns_ > 0) price();
    int32_t augmentations = 0;
    bool optimal = true;
    for (int row = 0; row < rows_ && columns_ > 0 && optimal; ++row)
      while (w_.supply[row] > rounding_) {
        const int column = augmentations++ < p_.most_augmentations ? search(row) : kFailed;
        optimal = column != kFailed;
        if (column < 0) break;
        push(row, column);
      }
    *p_.optimal = optimal;
    *p_.augmentations = augmentations;
    scatter();
  }

 private:
  static constexpr int kFailed = -1, kNoDemand = -2;

  double& cost(int row, int column) { return w_.cost[int64_t(row) * p_.width + column]; }
  double& flow(int row, int column) { return w_.flow[int64_t(row) * p_.width + column]; }

  // Rows and columns with mass; the width is filled up with columns that are too dear.
  void gather() {
    double total = 0;
    for (int i = 0; i < p_.rows; ++i)
      if (p_.supply[i] > 0) total += w_.supply[rows_] = p_.supply[i], w_.rows[rows_++] = i;
    for (int j = 0; j < p_.columns; ++j)
      if (p_.demand[j] > 0) w_.demand[columns_] = p_.demand[j], w_.columns[columns_++] = j;
    rounding_ = kRounding * total;
    cheapest_ = kInfinity, dearest_ = -kInfinity;
    for (int i = 0; i < rows_; ++i) {
      const T* given = p_.cost + int64_t(w_.rows[i]) * p_.columns;
      double* own = &cost(i, 0);
      for (int j = 0; j < columns_; ++j) {
        own[j] = given[w_.columns[j]];
        cheapest_ = least(own[j], cheapest_);
        dearest_ = -least(-own[j], -dearest_);
      }
      for (int j = columns_; j < p_.width; ++j) own[j] = kInfinity;
      for (int j = 0; j < p_.width; ++j) flow(i, j) = 0;
    }
    std::memset(w_.carriers, 0, sizeof(uint64_t) * columns_ * p_.words);
  }

  // The columns' prices are given or chosen; the rows' make the cheapest arc of each tight. As much as can be goes along
  // tight arcs.
  void price() {
    for (int j = 0; j < p_.width; ++j) w_.price[j] = 0;
    for (int i = 0; i < rows_; ++i) w_.row_price[i] = 0;
    if (p_.start[w_.columns[0]] < T(kInfinity))
      for (int j = 0; j < columns_; ++j) w_.price[j] = p_.start[w_.columns[j]];
    else
      choose_prices();
    for (int i = 0; i < rows_; ++i) {
      Doubles cheapest = load<double>(&cost(i, 0)) - load<double>(w_.price);
      for (int j = kLanes; j < p_.width; j += kLanes) {
        const Doubles own = load<double>(&cost(i, j)) - load<double>(w_.price + j);
        cheapest = select(own < cheapest, own, cheapest);
      }
      const double least_cost = lowest(cheapest);
      w_.row_price[i] = least_cost;
      for (int j = 0; j < columns_ && w_.supply[i] > 0; ++j)
        if (w_.demand[j] > 0 && cost(i, j) - w_.price[j] <= least_cost + kTight * (dearest_ - cheapest_)) {
          const double mass = least(w_.supply[i], w_.demand[j]);
          w_.supply[i] -= mass;
          w_.demand[j] -= mass;
          send(i, j, mass);
        }
    }
  }

  // The cheapest arc of each column is tight, seen from rows whose prices are those of a smoothed problem: with them half
  // of the augmentations are left.
  void choose_prices() {
    if (rows_ * columns_ > kFewArcs && dearest_ > cheapest_) smooth_row_prices();
    for (int j = 0; j < columns_; ++j) w_.price[j] = kInfinity;
    for (int i = 0; i < rows_; ++i)
      for (int j = 0; j < columns_; ++j) w_.price[j] = least(cost(i, j) - w_.row_price[i], w_.price[j]);
  }

  // A few sweeps of Sinkhorn's algorithm. The flow's matrix, still empty, holds the kernel.
  void smooth_row_prices() {
    const Smoothing& smoothing = rows_ * columns_ > kManyArcs ? kSmoothingOfMany : kSmoothing;
    const double unit = -1 / (smoothing.entropy * (dearest_ - cheapest_));
    for (int j = 0; j < p_.width; ++j) w_.distance[j] = j < columns_ ? 1 : 0;
    for (int i = 0; i < rows_; ++i)
      for (int j = 0; j < p_.width; j += kLanes)
        store(&flow(i, j), exponential<double>((load<double>(&cost(i, j)) - cheapest_) * unit));
    for (int sweep = 0; sweep < smoothing.sweeps; ++sweep) {
      for (int j = 0; j < p_.width; ++j) w_.open_price[j] = 0;
      for (int i = 0; i < rows_; ++i) {
        Doubles total{};
        for (int j = 0; j < p_.width; j += kLanes) total += load<double>(&flow(i, j)) * load<double>(w_.distance + j);
        const double scaling = w_.supply[i] / (sum<double>(total) + kSmallest);
        w_.row_price[i] = scaling;
        for (int j = 0; j < p_.width; j += kLanes)
          store(w_.open_price + j, load<double>(w_.open_price + j) + scaling * load<double>(&flow(i, j)));
      }
      for (int j = 0; j < columns_; ++j) w_.distance[j] = w_.demand[j] / (w_.open_price[j] + kSmallest);
    }
    for (int i = 0; i < rows_; ++i) {
      w_.row_price[i] = __builtin_log(w_.row_price[i] + kSmallest) / -unit;
      for (int j = 0; j < p_.width; ++j) flow(i, j) = 0;
    }
  }

  void send(int row, int column, double mass) {
    flow(row, column) += mass;
    w_.carriers[column * p_.words + row / kWord] |= uint64_t(1) << row % kWord;
  }

  void take_back(int row, int column, double mass) {
    if (!((flow(row, column) -= mass) > 0))
      w_.carriers[column * p_.words + row / kWord] &= ~(uint64_t(1) << row % kWord);
  }

  // The nearest column with demand left, seen from a row; the prices are moved so that the way to it is tight.
  int search(int root) {
    for (int word = 0; word < p_.words; ++word) w_.reached[word] = 0;
    for (int j = 0; j < p_.width; ++j) w_.distance[j] = kInfinity;
    std::memcpy(w_.open_price, w_.price, sizeof(double) * p_.width);
    relax(root, 0);
    for (int scanned = 0; scanned < columns_; ++scanned) {
      const int column = nearest_open();
      const double distance = w_.distance[column];
      if (!(distance < kInfinity)) return kFailed;
      if (w_.demand[column] > 0) {
        move_prices(distance);
        return column;
      }
      w_.open_price[column] = -kInfinity;
      w_.distance[column] = kInfinity;
      w_.last_distance[column] = distance;
      for (int word = 0; word < p_.words; ++word)
        for (uint64_t rows = w_.carriers[column * p_.words + word] & ~w_.reached[word]; rows != 0; rows &= rows - 1) {
          const int row = word * kWord + __builtin_ctzll(rows);
          w_.from_column[row] = column;
          relax(row, distance);
        }
    }
    return kNoDemand;
  }

  // The ways on from a row.
  void relax(int row, double distance) {
    w_.reached[row / kWord] |= uint64_t(1) << row % kWord;
    w_.row_distance[row] = distance;
    const double* costs = w_.cost + int64_t(row) * p_.width;
    const Doubles base = all(distance - w_.row_price[row]);
    const Integers own = all(int64_t(row));
    for (int j = 0; j < p_.width; j += kLanes) {
      const Doubles way = base + (load<double>(costs + j) - load<double>(w_.open_price + j));
      const Doubles known = load<double>(w_.distance + j);
      const Integers shorter = way < known;
      store(w_.distance + j, select(shorter, way, known));
      store(w_.from_row + j, select(shorter, own, load<int64_t>(w_.from_row + j)));
    }
  }

  int nearest_open() {
    Doubles nearest = load<double>(w_.distance);
    static constexpr int64_t kFirst[] = {0, 1, 2, 3, 4, 5, 6, 7};
    Integers columns = load(kFirst), best = columns;
    for (int j = kLanes; j < p_.width; j += kLanes) {
      columns += int64_t(kLanes);
      const Doubles distances = load<double>(w_.distance + j);
      const Integers nearer = distances < nearest;
      nearest = select(nearer, distances, nearest);
      best = select(nearer, columns, best);
    }
    best = select(nearest <= lowest(nearest), best, all(int64_t(p_.width)));
    return int(lowest(best)) % p_.width;
  }

  void move_prices(double distance) {
    for (int word = 0; word < p_.words; ++word)
      for (uint64_t rows = w_.reached[word]; rows != 0; rows &= rows - 1) {
        const int row = word * kWord + __builtin_ctzll(rows);
        w_.row_price[row] += distance - w_.row_distance[row];
      }
    for (int j = 0; j < columns_; ++j)
      if (w_.open_price[j] == -kInfinity) w_.price[j] -= distance - w_.last_distance[j];
  }

  // As much as the path can take: from its columns mass goes back to the rows that it came from.
  void push(int root, int end) {
    double mass = least(w_.supply[root], w_.demand[end]);
    for (int row = int(w_.from_row[end]); row != root; row = int(w_.from_row[w_.from_column[row]]))
      mass = least(mass, flow(row, w_.from_column[row]));
    int column = end;
    for (int row = int(w_.from_row[column]);; row = int(w_.from_row[column])) {
      send(row, column, mass);
      if (row == root) break;
      column = w_.from_column[row];
      take_back(row, column, mass);
    }
    w_.supply[root] -= mass;
    w_.demand[end] -= mass;
  }

  // The plan; and of what has no mass the price at which its first grain would travel.
  void scatter() {
    std::memset(p_.plan, 0, sizeof(T) * p_.rows * p_.columns);
    for (int i = 0; i < rows_; ++i)
      for (int j = 0; j < columns_; ++j)
        p_.plan[int64_t(w_.rows[i]) * p_.columns + w_.columns[j]] = T(flow(i, j));
    for (int i = 0; i < rows_; ++i) p_.row_potentials[w_.rows[i]] = T(w_.row_price[i]);
    for (int j = 0; j < columns_; ++j) p_.column_potentials[w_.columns[j]] = T(w_.price[j]);
    for (int i = 0; i < p_.rows; ++i)
      if (!(p_.supply[i] > 0)) {
        double lowest = kInfinity;
        for (int j = 0; j < columns_; ++j)
          lowest = least(double(p_.cost[int64_t(i) * p_.columns + w_.columns[j]]) - w_.price[j], lowest);
        p_.row_potentials[i] = T(columns_ > 0 ? lowest : 0);
      }
    for (int j = 0; j < p_.columns; ++j)
      if (!(p_.demand[j] > 0)) {
        double lowest = kInfinity;
        for (int i = 0; i < rows_; ++i)
          lowest = least(double(p_.cost[int64_t(w_.rows[i]) * p_.columns + j]) - w_.row_price[i], lowest);
        p_.column_potentials[j] = T(rows_ > 0 ? lowest : 0);
      }
  }

  const TransportProblem<T>& p_;
  const TransportWorkspace& w_;
  int rows_ = 0, columns_ = 0;
  double rounding_ = 0, cheapest_ = 0, dearest_ = 0;
};

}  // namespace

void transport(const TransportProblem<double>& problem) { Transport<double>(problem).run(); }
void transport(const TransportProblem<float>& problem) { Transport<float>(problem).run(); }

}  // namespace gmmjax::GMMJAX_INSTRUCTION_SET
