// Projects points through a camera file, with nothing but the standard library:
//
//   g++ -std=c++17 -O2 -o project project.cpp
//   echo "0.05 0.02 0.08" | ./project front.yaml        x y z in metres, camera frame: x right, y down, z forward
//
// prints "u v 1" in pixels for each point, or "nan nan 0" where the camera has no image of it.
//
// It reads camera files as fisheye_ep_calib writes them (each list and each set of intrinsics on its own line),
// with the lenses kannala_brandt and kannala_brandt_6, all pupil families and the tangential terms.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

struct Camera {
  double fx, fy, skew, cx, cy;
  double p1, p2;           // tangential
  std::vector<double> k;   // r(θ) = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + …
  std::string model;       // pupil family
  std::vector<double> e;   // coefficients of E(θ), metres
  double theta_max;        // rad
};

struct Pixel {
  double u, v;
  bool valid;
};

// --- reading -------------------------------------------------------------------------------------------------

// The text after "  key: " in the block entrance_pupil.
std::string line_of(const std::vector<std::string>& lines, const std::string& key) {
  const std::string start = "  " + key + ": ";
  for (const auto& line : lines)
    if (line.compare(0, start.size(), start) == 0) return line.substr(start.size());
  throw std::runtime_error("no entrance_pupil." + key);
}

double number_after(const std::string& text, const std::string& key) {
  const auto at = text.find(key + ": ");
  if (at == std::string::npos) throw std::runtime_error("no " + key);
  return std::strtod(text.c_str() + at + key.size() + 2, nullptr);
}

std::vector<double> list_of(const std::string& text) {
  std::vector<double> values;
  std::string numbers = text;
  std::replace_if(numbers.begin(), numbers.end(), [](char c) { return c == '[' || c == ']' || c == ','; }, ' ');
  std::istringstream stream(numbers);
  for (double value; stream >> value;) values.push_back(value);
  return values;
}

Camera read_camera(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read " + path);
  std::vector<std::string> lines;
  bool inside = false;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty() && line[0] != ' ') inside = line == "entrance_pupil:";
    if (inside) lines.push_back(line);
  }
  if (list_of(line_of(lines, "schema")) != std::vector<double>{1}) throw std::runtime_error("schema is not 1");
  if (line_of(lines, "lens").rfind("kannala_brandt", 0) != 0) throw std::runtime_error("this example has Kannala–Brandt only");
  for (double value : list_of(line_of(lines, "tilt")))
    if (value != 0) throw std::runtime_error("this example has no tilt");

  Camera camera{};
  const auto intrinsics = line_of(lines, "intrinsics");
  camera.fx = number_after(intrinsics, "fx");
  camera.fy = number_after(intrinsics, "fy");
  camera.skew = number_after(intrinsics, "skew");
  camera.cx = number_after(intrinsics, "cx");
  camera.cy = number_after(intrinsics, "cy");
  camera.k = list_of(line_of(lines, "radial"));
  const auto tangential = list_of(line_of(lines, "tangential"));
  if (camera.k.size() < 4 || tangential.size() != 2) throw std::runtime_error("radial or tangential is damaged");
  camera.p1 = tangential[0];
  camera.p2 = tangential[1];
  camera.model = line_of(lines, "model");
  camera.e = list_of(line_of(lines, "coefficients"));
  camera.theta_max = list_of(line_of(lines, "theta_max")).at(0);
  return camera;
}

// --- the model -----------------------------------------------------------------------------------------------

// basis_i(θ) of E(θ) = Σ e_i basis_i(θ).
double basis(const std::string& model, int i, double theta) {
  if (model == "kannala") return 0;
  if (model == "ep_odd") return std::pow(theta, 3 + 2 * i);
  if (model == "ep_even") return std::pow(theta, 2 + 2 * i);
  if (model == "gennery") {
    const double square = theta * theta;
    const double factor = theta < 1e-2 ? square * (1.0 / 6 + square * 7 / 360) : theta / std::sin(theta) - 1;
    return -factor * std::pow(theta, 2 * i);
  }
  throw std::runtime_error("unknown model " + model);
}

// E(θ), metres. It is added to the point's z; the pupil sits at z = −E(θ).
double entrance_pupil(const Camera& camera, double theta) {
  double shift = 0;
  for (size_t i = 0; i < camera.e.size(); ++i) shift += camera.e[i] * basis(camera.model, static_cast<int>(i), theta);
  return shift;
}

double radius(const Camera& camera, double theta) {
  double sum = 0;
  for (size_t i = camera.k.size(); i-- > 0;) sum = theta * theta * (camera.k[i] + sum);
  return theta * (1 + sum);
}

double radius_slope(const Camera& camera, double theta) {
  double sum = 0;
  for (size_t i = camera.k.size(); i-- > 0;) sum = theta * theta * ((2 * i + 3) * camera.k[i] + sum);
  return 1 + sum;
}

// The largest angle with a projection: theta_max, or where r(θ) stops increasing.
double theta_limit(const Camera& camera) {
  const int steps = 1000;
  for (int i = 0; i <= steps; ++i)
    if (!(radius_slope(camera, camera.theta_max * i / steps) > 0)) return camera.theta_max * std::max(0, i - 1) / steps;
  return camera.theta_max;
}

// g(θ) = ρ cosθ − (z + E(θ)) sinθ is positive below the angle we want and negative above it. Outside the caustic it
// changes sign once in the bracket, so halving the bracket finds it.
Pixel project(const Camera& camera, double limit, double x, double y, double z) {
  const Pixel nothing{NAN, NAN, false};
  const double rho = std::hypot(x, y);
  const auto g = [&](double theta) {
    return rho * std::cos(theta) - (z + entrance_pupil(camera, theta)) * std::sin(theta);
  };
  if (rho == 0 && z <= 0) return nothing;
  double low = 0, high = limit;
  if (rho > 0 && g(high) > 0) return nothing;  // seen at a larger angle than the camera knows
  if (rho == 0) high = 0;
  for (int i = 0; i < 60 && high > 0; ++i) {
    const double middle = 0.5 * (low + high);
    (g(middle) > 0 ? low : high) = middle;
  }
  const double theta = 0.5 * (low + high), step = 1e-6;
  // Inside the caustic (D ≤ −E′ sinθ) there is no image, or there are several.
  const double distance = std::hypot(rho, z + entrance_pupil(camera, theta));
  const double slope = (entrance_pupil(camera, theta + step) - entrance_pupil(camera, std::max(theta - step, 0.0))) /
                       (theta + step - std::max(theta - step, 0.0));
  if (distance + slope * std::sin(theta) <= 0) return nothing;

  const double r = radius(camera, theta);
  const double mx = rho > 0 ? r * x / rho : 0, my = rho > 0 ? r * y / rho : 0;
  const double s = mx * mx + my * my;
  const double dx = mx + 2 * camera.p1 * mx * my + camera.p2 * (s + 2 * mx * mx);
  const double dy = my + camera.p1 * (s + 2 * my * my) + 2 * camera.p2 * mx * my;
  return {camera.fx * dx + camera.skew * dy + camera.cx, camera.fy * dy + camera.cy, true};
}

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: project CAMERA.yaml < points\n");
    return 2;
  }
  try {
    const Camera camera = read_camera(argv[1]);
    const double limit = theta_limit(camera);
    for (double x, y, z; std::cin >> x >> y >> z;) {
      const Pixel pixel = project(camera, limit, x, y, z);
      std::printf("%.9f %.9f %d\n", pixel.u, pixel.v, pixel.valid);
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "project: %s\n", error.what());
    return 2;
  }
}
