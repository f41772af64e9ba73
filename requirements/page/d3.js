// What the page projects the sky with; everything else of d3 stays out of the bundle.
export { geoAzimuthalEqualArea, geoCircle, geoGraticule, geoOrthographic, geoPath, geoRotation } from "d3-geo";
export { geoHammer, geoMollweide } from "d3-geo-projection";
