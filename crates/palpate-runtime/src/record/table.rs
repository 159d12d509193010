//! A record as a row of a table: one column a number, losslessly.

use super::{Field, Record};
use bytemuck::bytes_of;

/// What a name may end in as a unit; a vector's component stands before it, as in `x_m`.
const UNITS: [&str; 5] = ["_rad_per_s", "_m_per_s", "_nm", "_m", "_n"];
/// What is of the file, not of the loop.
const FILE: [&str; 5] = ["kind", "spare", "spare_half", "spare_word", "crc"];

impl Record {
    /// Names of the columns of [`row`](Self::row), with their units: the fields in their order, vectors by component.
    pub fn columns() -> Vec<String> {
        let components = |field: &Field| -> Vec<String> {
            let letters: &[&str] = match (field.count, field.name.as_str()) {
                (1, name) => return vec![name.into()],
                (_, "area_coordinates") => &["1", "2", "3"],
                (4, _) => &["w", "x", "y", "z"],
                _ => &["x", "y", "z"],
            };
            let unit = UNITS.into_iter().find(|unit| field.name.ends_with(unit)).unwrap_or_default();
            let stem = field.name.strip_suffix(unit).unwrap_or(&field.name);
            letters.iter().map(|letter| format!("{stem}_{letter}{unit}")).collect()
        };
        tabled().iter().flat_map(components).collect()
    }

    /// Its numbers as text that reads back to the same bits.
    pub fn row(&self) -> Vec<String> {
        let bytes = bytes_of(self);
        let values = |field: Field| -> Vec<String> {
            let word = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
            let half = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
            let value = |i: u32| match field.kind.as_str() {
                "u32" => half((field.offset + 4 * i) as usize).to_string(),
                kind => match (kind, word((field.offset + 8 * i) as usize)) {
                    ("f64", bits) => f64::from_bits(bits).to_string(),
                    ("i64", bits) => bits.cast_signed().to_string(),
                    (_, bits) => bits.to_string(),
                },
            };
            (0..field.count).map(value).collect()
        };
        tabled().into_iter().flat_map(values).collect()
    }
}

/// The fields that make columns.
fn tabled() -> Vec<Field> {
    Record::fields().into_iter().filter(|field| !FILE.contains(&field.name.as_str())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn names_carry_their_units_and_numbers_their_bits() {
        let third = 1.0 / 3.0;
        let record = Record {
            number: u64::MAX,
            lateness_ns: -7,
            device_velocity_m_per_s: [0.0, third, f64::NAN],
            element: Record::NONE,
            command_torque_nm: [0.0, 0.0, 1e-300],
            ..Record::zeroed()
        };
        let (columns, row) = (Record::columns(), record.row());
        assert_eq!(columns.len(), row.len());
        let cell = |name: &str| row[columns.iter().position(|c| c == name).expect(name)].as_str();
        assert_eq!(cell("number"), u64::MAX.to_string());
        assert_eq!(cell("lateness_ns"), "-7");
        assert_eq!(cell("device_velocity_y_m_per_s").parse(), Ok(third));
        assert_eq!(cell("device_velocity_z_m_per_s"), "NaN");
        assert_eq!(cell("command_torque_z_nm").parse(), Ok(1e-300));
        assert_eq!(cell("element"), "4294967295");
        for name in ["time_s", "tool_orientation_w", "area_coordinates_3", "force_x_n", "work_j"] {
            assert_eq!(cell(name), "0", "{name}");
        }
        assert!(!columns.iter().any(|c| c.starts_with("spare") || c == "crc"));
    }
}
